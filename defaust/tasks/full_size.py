"""Ground truth at high resolution: target poses of a remeshed rest mesh, in vertex correspondence with it.

A dataset stores target poses at the resolution of the registered meshes only. For a finer rest mesh they are
computed when a task is loaded. The registered mesh is subdivided as in the build, so every vertex of the rest
mesh lies on a triangle of the subdivided mesh. Synthetic bodies and animals are skinned: the skinning weights
are subdivided and interpolated on that triangle. For other meshes the subdivided registered pose is
interpolated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from defaust.build.upsample import subdivide
from defaust.sources import animals, new_bodies, noisy, synthetic
from defaust.sources.bodies import SkinnedSource
from defaust.sources.skinning import apply_motions
from defaust.tasks.loop import loop_matrix
from sshade import InputError, Mesh

#: Maximum distance of a remeshed surface from the subdivided one, as a fraction of the diagonal.
ON_SURFACE = 1e-6

#: Sources of skinned bodies, by the checksums of the assets of their bodies and of their poses.
SKINNED: dict[tuple[str, str | None], type[SkinnedSource]] = {
    (synthetic.SHA256, None): synthetic.SyntheticBodies,
    (synthetic.SHA256, noisy.POSES_SHA256): noisy.NoisyBodies,
    (new_bodies.SHA256, None): new_bodies.NewBodies,
    (animals.SHA256, None): animals.Animals,
}

#: Poses vertex positions (n, 3).
PoseSurface = Callable[[np.ndarray], np.ndarray]


class Registered(NamedTuple):
    """The stored meshes of a subject in a pose.

    Attributes
    ----------
    rest : Mesh
        Rest mesh at the resolution of the task; the same object as `low` at low resolution.
    low, posed : Mesh
        Registered rest mesh and target pose.
    steps : int
        Number of subdivisions between `low` and `rest`.
    noisy : bool
        The registered target pose has noise and is no ground truth.
    """

    rest: Mesh
    low: Mesh
    posed: Mesh
    steps: int
    noisy: bool = False


def true_pose(meshes: Registered, skin: PoseSurface | None) -> tuple[np.ndarray, str]:
    """Compute the positions of the rest mesh's vertices in the pose.

    Without a skin, the registered pose is subdivided and interpolated.

    Returns
    -------
    (n, 3) float64
    str
        Origin of the positions: ``registration``, ``skinning`` or ``subdivision``.

    Raises
    ------
    InputError
        When the rest mesh does not lie on the subdivided rest mesh.
    """
    if meshes.rest is meshes.low and not meshes.noisy:
        return meshes.posed.V, "registration"
    if skin is not None:
        return skin(meshes.rest.V), "skinning"
    fine, interpolate = _on_subdivided(meshes)
    fine_posed = subdivide(meshes.posed, steps=meshes.steps)
    return interpolate @ fine_posed.V, "subdivision"


def find_skin(
    meshes: Registered, source: Mapping[str, Any], *, subject: int, pose: str
) -> PoseSurface | None:
    """Dual quaternion skinning of a synthetic body or animal into a pose, at the vertices of the rest mesh.

    The weights are subdivided by Loop's rules. Linear interpolation on the registered triangles would
    crease weights and posed surface along edges.

    Parameters
    ----------
    meshes : Registered
    source : mapping
        The dataset's record of its source.
    subject : int
    pose : str
        Name of the pose.

    Returns
    -------
    callable, optional
        Poses vertex positions (n, 3), which an edit may have moved. None if the source has no skinning.

    Raises
    ------
    InputError
        When the package has no such bodies, or the rest mesh does not lie on the subdivided registered
        mesh.
    """
    asset, poses = source.get("asset_sha256"), source.get("poses_sha256")
    if asset is None:
        return None
    if (asset, poses) not in SKINNED:
        raise InputError(
            f"the dataset was made from bodies or poses of another version (asset {asset[:12]}); "
            "build it again"
        )
    motions, shift = SKINNED[asset, poses]().motions(subject, pose)
    if meshes.rest is not meshes.low:
        # Blending is linear, so subdividing the motions is the same as subdividing the weights.
        fine, interpolate = _on_subdivided(meshes)
        motions = interpolate @ (loop_matrix(meshes.low, fine, steps=meshes.steps) @ motions)
    return lambda V: apply_motions(motions, V) + shift


def _on_subdivided(meshes: Registered) -> tuple[Mesh, csr_array]:
    """Subdivide the registered mesh; return it with the interpolation at the vertices of the rest mesh."""
    fine = subdivide(meshes.low, steps=meshes.steps)
    interpolate, distance = interpolation(meshes.rest.V, fine.V, fine.F)
    off = distance.max() / meshes.low.diagonal
    if off > ON_SURFACE:
        raise InputError(
            f"the rest mesh was not made from the subdivided registered mesh: it is up to {off:.1g} x the "
            "diagonal away; build the dataset again"
        )
    return fine, interpolate


def interpolation(points: np.ndarray, V: np.ndarray, F: np.ndarray) -> tuple[csr_array, np.ndarray]:
    """Barycentric interpolation of vertex values at the surface points nearest to given points.

    Parameters
    ----------
    points : (k, 3) float64
    V : (n, 3) float64
    F : (m, 3) int64

    Returns
    -------
    (k, n) sparse float64
        Each row has three nonnegative entries that add up to 1.
    (k,) float64
        Distances of the points to the surface.
    """
    import igl

    squared, face, nearest = igl.point_mesh_squared_distance(points, V, F)
    corners = F[face]
    a, b, c = (np.ascontiguousarray(V[corners[:, k]]) for k in range(3))
    weights = np.maximum(0.0, igl.barycentric_coordinates(nearest, a, b, c))
    weights /= weights.sum(axis=1, keepdims=True)
    rows = 3 * np.arange(len(points) + 1)
    return csr_array((weights.ravel(), corners.ravel(), rows), shape=(len(points), len(V))), np.sqrt(squared)
