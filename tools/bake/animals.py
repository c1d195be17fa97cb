"""Bake the asset of the animals from animals.yaml: ``python -m tools.bake animals --out FILE``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import igl
import numpy as np
import yaml
from scipy.sparse import diags_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from defaust.build.upsample import remesh, self_intersecting
from defaust.sources.animals import unpack
from defaust.sources.skinning import apply_motions, bone_motions
from sshade import InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from tools.bake.capsules import MIRROR, Rig, make_rig
from tools.bake.template import neighbour_average, quantise_weights

TABLE = Path(__file__).with_suffix(".yaml")
#: Accepted relative error of the number of vertices, and maximum number of remeshings.
CLOSE, ATTEMPTS = 0.05, 8
#: Side of the lattice cells, as a multiple of the wanted edge length.
FINER = 0.85
#: Half steps of Laplacian smoothing.
SMOOTHINGS = 6
#: Diagonal of the box in cells of the coarse lattice that measures the area.
COARSE = 60
#: Reciprocal square of the distance over which weights fade, in radii of the limb.
HEAT = 1.5
#: Subtracted from each weight. Faint weights would connect the legs through the body.
FAINT = 0.05
#: Maximum number of bones of a vertex.
BONES = 8
#: Number of steps of the asset's lattice along the longest side of the bounding box.
STEPS = 2**16 - 1
#: Size of a stored difference, in bytes.
BYTES = 3


def read_table() -> dict[str, dict[str, Any]]:
    """Tables of the species, by name."""
    return yaml.safe_load(TABLE.read_text(encoding="utf-8"))


def bake_animal(species: dict[str, Any]) -> dict[str, np.ndarray]:
    """Make the arrays of a species; see :func:`defaust.sources.animals.decode`."""
    rig = make_rig(species)
    packed = pack(make_mesh(rig, species["vertices"]))
    V, F = unpack(packed)
    bone, weight = quantise_weights(bone_weights(rig, V, F), keep=BONES)
    rotations, shifts = make_poses(rig, species["poses"])
    landmarks = find_landmarks(V, species["landmarks"])
    return packed | {
        "joints": rig.joints.astype(np.float32),
        "parents": rig.parents.astype(np.int8),
        "bones": np.array(rig.bones),
        "bone": np.where(weight > 0, bone, 0).astype(np.uint8),
        "weight": weight,
        "rotations": rotations.astype(np.float32),
        "shifts": shifts.astype(np.float32),
        "pose_names": np.array(list(species["poses"])),
        "turned": np.array([bool(pose.get("turned")) for pose in species["poses"].values()]),
        "landmarks": np.array(list(landmarks.values()), dtype=np.uint16),
        "landmark_names": np.array(list(landmarks)),
    }


def pack(mesh: Mesh) -> dict[str, np.ndarray]:
    """Encode a mesh of less than 4 million vertices in arrays that compress well.

    Positions are rounded to a cubic lattice; no coordinate moves by more than half a lattice step. Vertices
    are numbered in reverse Cuthill-McKee order, and faces are sorted.

    Returns
    -------
    dict
        See :func:`defaust.sources.animals.unpack`.
    """
    corner = mesh.V.min(axis=0)
    step = (mesh.V.max(axis=0) - corner).max() / STEPS
    order = reverse_cuthill_mckee(vertex_graph(mesh).matrix.tocsr(), symmetric_mode=True)
    number = np.empty(mesh.n, dtype=np.int64)
    number[order] = np.arange(mesh.n)
    lattice = np.round((mesh.V[order] - corner) / step).astype(np.int64)
    F = number[mesh.F]
    F = np.take_along_axis(F, (F.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    F = F[np.lexsort(F.T[::-1])]
    F = np.diff(F, axis=1, prepend=0)
    F[:, 0] = np.diff(F[:, 0], prepend=0)
    return {
        "corner": corner,
        "step": np.float64(step),
        "vertices": _planes(np.diff(lattice, axis=0, prepend=0)),
        "faces": _planes(F),
    }


def _planes(integers: np.ndarray) -> np.ndarray:
    """Split signed integers (k, 3) into their bytes (BYTES, k, 3) uint8; small integers need one byte."""
    unsigned = np.where(integers < 0, -2 * integers - 1, 2 * integers)
    return np.stack([(unsigned >> 8 * k & 0xFF).astype(np.uint8) for k in range(BYTES)])


def zero_level(rig: Rig, *, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of the surface of a rig, by marching cubes on a lattice."""
    x, y, z = (np.arange(a, b + step, step) for a, b in zip(*rig.box, strict=True))
    sheets = [np.stack(np.meshgrid(x, y, [height]), axis=-1).reshape(-1, 3) for height in z]
    values = np.concatenate([rig.level(sheet) for sheet in sheets])
    return igl.marching_cubes(values, np.concatenate(sheets), len(x), len(y), len(z))[:2]


def make_mesh(rig: Rig, vertices: int) -> Mesh:
    """Triangulate the surface of a rig with about this many vertices.

    The triangles of marching cubes are remeshed, with another edge length until the number fits.

    Raises
    ------
    InputError
        When no edge length gives a closed manifold without handles that does not intersect itself.
    """
    low, high = rig.box
    coarse = Mesh(*zero_level(rig, step=float(np.linalg.norm(high - low)) / COARSE))
    length = float(np.sqrt(2.0 / np.sqrt(3.0) * coarse.area / vertices))
    V, F = zero_level(rig, step=FINER * length)
    average = neighbour_average(F)
    for _ in range(SMOOTHINGS):  # the remesher would keep the edges of slivers as creases
        V = 0.5 * (V + average @ V)
    fine = Mesh(V, F)
    for _ in range(ATTEMPTS):
        mesh = Mesh(*remesh(fine, edge_length=length, iterations=6))
        is_good = mesh.is_manifold and mesh.is_closed and mesh.topology == (2, 1, 0)
        if is_good and abs(mesh.n - vertices) <= CLOSE * vertices and not self_intersecting(mesh).any():
            return mesh
        length *= float(np.sqrt(mesh.n / vertices))
    raise InputError(
        f"{ATTEMPTS} remeshings gave no mesh of {vertices} vertices without self-intersections; "
        "change the shape or the number of vertices in animals.yaml"
    )


def bone_weights(rig: Rig, V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Smooth weights (n, b) of the bones, by diffusion from the nearest bones along the surface.

    I. Baran, J. Popovic, "Automatic rigging and animation of 3D characters", 2007.
    """
    nearest, radius = rig.nearest(V)
    indicator = np.zeros((len(V), len(rig.bones)))
    indicator[np.arange(len(V)), nearest] = 1.0
    mass = np.asarray(igl.massmatrix(V, F, igl.MASSMATRIX_TYPE_VORONOI).diagonal())
    heat = HEAT * mass / radius**2
    W = splu((diags_array(heat) - igl.cotmatrix(V, F)).tocsc()).solve(heat[:, None] * indicator)
    W = np.maximum(W - FAINT, 0.0)
    return _one_limb(rig, W / W.sum(axis=1, keepdims=True))


def _one_limb(rig: Rig, W: np.ndarray) -> np.ndarray:
    """Change weights (n, b) such that each vertex follows at most one limb.

    The weight of a limb is reduced by the largest weight of another limb. The body takes the remainder.
    """
    W = W.copy()
    numbers = np.unique(rig.limbs[rig.limbs >= 0])
    total = np.stack([W[:, rig.limbs == limb].sum(axis=1) for limb in numbers])
    for i, limb in enumerate(numbers):
        bones = rig.limbs == limb
        kept = np.maximum(total[i] - np.delete(total, i, axis=0).max(axis=0), 0.0)
        W[:, bones] *= np.divide(kept, total[i], out=np.zeros_like(kept), where=total[i] > 0)[:, None]
        W[:, rig.parents[np.flatnonzero(bones)[0]]] += total[i] - kept
    return W


def make_poses(rig: Rig, poses: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors (p, b, 3) in radians and shifts (p, 3) of the poses of a species."""
    rotations = np.zeros((len(poses), len(rig.bones), 3))
    shifts = np.zeros((len(poses), 3))
    for k, pose in enumerate(poses.values()):
        for name, angles in pose["bones"].items():
            sides = (
                {name: (1, 1, 1)} if name in rig.bones else {f"{name}_l": (1, 1, 1), f"{name}_r": (1, -1, -1)}
            )
            for bone, sign in sides.items():
                rotations[k, rig.bones.index(bone)] = np.radians(np.multiply(angles, sign))
        motions = bone_motions(rig.joints, rig.parents, rotations=rotations[k])
        plant = rig.bones.index(pose["plant"])
        shifts[k] = rig.joints[plant] - apply_motions(motions[[plant]], rig.joints[[plant]])[0]
    return rotations, shifts


def find_landmarks(V: np.ndarray, points: dict[str, list[float]]) -> dict[str, int]:
    """Vertex nearest to each point; a name in _l has a mirrored partner in _r."""
    found = {}
    for name, point in points.items():
        found[name] = int(np.linalg.norm(V - point, axis=1).argmin())
        if name.endswith("_l"):
            found[f"{name[:-2]}_r"] = int(np.linalg.norm(V - MIRROR * point, axis=1).argmin())
    return found


def bake(_: Path | None) -> dict[str, np.ndarray]:
    """Bake every species; return the arrays of the asset."""
    arrays = {}
    for name, species in read_table().items():
        arrays |= {f"{name}.{key}": value for key, value in bake_animal(species).items()}
    return arrays
