"""Coarse tetrahedra inside a closed surface, with barycentric coordinates for the surface.

The surface is first sampled like a proxy, because fTetWild's time grows with its input. fTetWild then fills
the samples' surface. It accepts self-intersections and merges surfaces closer than its envelope. It has no
seed, so another process gets other tetrahedra. Within a process the tetrahedra are cached, also for the same
mesh moved or scaled. Each vertex of the mesh keeps its barycentric coordinates in the tetrahedron around it.

Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral meshing in the wild", 2020; pytetwild.
"""

from __future__ import annotations

import subprocess
import sys
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple, TypedDict

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.proxy.sample import proxy_mesh, sample_proxy

#: Grid to which coordinates are rounded, as a fraction of the diagonal: meshes that differ by rounding errors
#: share their tetrahedra.
GRID = 2.0**-23
#: Number of nearest tetrahedra that are searched for a vertex of the surface.
NEAR = 32
#: Number of meshes whose tetrahedra are cached.
CACHED = 8
#: Energy at which fTetWild stops to optimise the tetrahedra (its default: 10).
STOP_ENERGY = 20.0
#: Maximum number of fTetWild's optimisation steps (its default: 80).
STEPS = 20
#: Time limit of fTetWild in seconds.
LIMIT = 600

#: Program that runs fTetWild in a separate process, because fTetWild writes files to its working folder, may
#: end the process, and has no time limit.
FILL = """
import sys
import numpy as np
from pytetwild import tetrahedralize
edge, envelope, energy, steps = map(float, sys.argv[1:])
surface = np.load("surface.npz", allow_pickle=False)
nodes, T = tetrahedralize(
    surface["V"], surface["F"], edge_length_fac=edge, epsilon=envelope,
    stop_energy=energy, num_opt_iter=int(steps), num_threads=1,
)[:2]
np.savez("filled.npz", nodes=nodes, T=T)
"""


class TetrahedraOptions(TypedDict, total=False):
    """Size of the tetrahedra.

    Attributes
    ----------
    samples : int
        Vertices of the surface that is filled. A mesh with fewer vertices is filled without sampling.
    edge : float
        Target length of inner edges, as a fraction of the diagonal. Smaller values give more tetrahedra.
    envelope : float
        Maximum distance of the tetrahedra's surface from the samples' surface, as a fraction of the diagonal.
        Lower it if limbs merge.
    """

    samples: int
    edge: float
    envelope: float


class CoarseTetrahedra(NamedTuple):
    """Tetrahedra that fill a mesh.

    Attributes
    ----------
    V : (p, 3) float64
        Nodes, in the mesh's coordinates.
    T : (t, 4) int64
        Tetrahedra of positive volume.
    volumes : (t,) float64
        Their volumes.
    carry : (n, p) sparse float64
        Barycentric coordinates, four per row: ``carry @ V`` are the mesh's vertices.
    component : (p,) int
        Connected component of each node.
    seconds : float
        Time that fTetWild took.
    """

    V: np.ndarray
    T: np.ndarray
    volumes: np.ndarray
    carry: csr_array
    component: np.ndarray
    seconds: float

    def facts(self) -> dict[str, float]:
        """Return the entries of a row. Only the first run on a mesh spends ``tetrahedra_seconds``."""
        return {"nodes": len(self.V), "tetrahedra": len(self.T), "tetrahedra_seconds": self.seconds}

    def inverted(self, nodes: np.ndarray) -> int:
        """Return the number of tetrahedra that are inverted, or without volume, at positions (p, 3)."""
        return int((six_volumes(nodes, self.T) <= 0).sum())


def coarse_tetrahedra(
    mesh: Mesh, *, samples: int = 3000, edge: float = 0.04, envelope: float = 1e-3
) -> CoarseTetrahedra:
    """Fill a surface with tetrahedra, or return the cached tetrahedra of the same mesh, moved and scaled.

    Parameters
    ----------
    mesh : Mesh
        Closed. It may intersect itself and have several components. A mesh with more vertices than `samples`
        must be manifold and oriented.
    samples, edge, envelope
        See :class:`TetrahedraOptions`.

    Raises
    ------
    ImportError
        If pytetwild is not installed.
    InputError
        If the surface has a boundary, encloses no volume, or cannot be sampled.
    """
    if len(mesh.boundary_edges):
        raise InputError(
            f"tetrahedra fill closed surfaces, and this one has {len(mesh.boundary_edges)} boundary edges; "
            "close its holes, or use a surface method"
        )
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    rounded = np.round((mesh.V - centre) / (scale * GRID)) * GRID + 0.0  # no negative zeros
    V, T, seconds = _unit_tetrahedra(rounded.tobytes(), mesh.F.tobytes(), samples, edge, envelope)
    return CoarseTetrahedra(
        V=V * scale + centre,
        T=T,
        volumes=six_volumes(V, T) / 6 * scale**3,
        carry=barycentric_coordinates(V, T, (mesh.V - centre) / scale),
        component=_components(len(V), T),
        seconds=seconds,
    )


@lru_cache(CACHED)
def _unit_tetrahedra(
    V: bytes, F: bytes, samples: int, edge: float, envelope: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the nodes and tetrahedra of a mesh of unit size, whose arrays are bytes, and fTetWild's time."""
    mesh = Mesh(np.frombuffer(V, np.float64).reshape(-1, 3), np.frombuffer(F, np.int64).reshape(-1, 3))
    begin = perf_counter()
    nodes, T = _filled(*_sampled(mesh, samples), edge=edge, envelope=envelope)
    return nodes, T, perf_counter() - begin


def _sampled(mesh: Mesh, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return V (s, 3) and F (g, 3) of proxies of all components; the samples are distributed by area."""
    if samples >= mesh.n:
        return np.array(mesh.V), np.array(mesh.F)
    areas = np.bincount(mesh.component[mesh.F[:, 0]], mesh.face_areas)
    V, F, count = [], [], 0
    for component in np.unique(mesh.component[mesh.F[:, 0]]):
        vertices = np.flatnonzero(mesh.component == component)
        part = mesh.part(vertices, mesh.component[mesh.F[:, 0]] == component)
        number = max(round(samples * areas[component] / mesh.area), 4)
        if number < part.n:
            part = proxy_mesh(part, sample_proxy(part, number))
        V.append(part.V)
        F.append(part.F + count)
        count += part.n
    return np.concatenate(V), np.concatenate(F)


def _filled(V: np.ndarray, F: np.ndarray, *, edge: float, envelope: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and the tetrahedra of positive volume from fTetWild."""
    if find_spec("pytetwild") is None:
        raise ModuleNotFoundError("No module named 'pytetwild'", name="pytetwild")
    with TemporaryDirectory() as folder:
        np.savez(Path(folder, "surface.npz"), V=V, F=F.astype(np.int32))
        command = [sys.executable, "-c", FILL, *map(str, (edge, envelope, STOP_ENERGY, STEPS))]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=LIMIT)
        except subprocess.TimeoutExpired as error:
            raise InputError(f"fTetWild could not fill the surface within {LIMIT} s") from error
        if done.returncode:
            said = done.stderr.strip().splitlines() or [f"its process ended with {done.returncode}"]
            raise InputError(f"fTetWild could not fill the surface: {said[-1]}")
        with np.load(Path(folder, "filled.npz"), allow_pickle=False) as filled:
            nodes, T = filled["nodes"], filled["T"]
    T = np.asarray(T, dtype=np.int64).reshape(-1, 4)
    volumes = six_volumes(nodes, T)
    T = np.where((volumes < 0)[:, None], T[:, [0, 2, 1, 3]], T)[volumes != 0]
    if len(T) == 0:
        raise InputError("fTetWild found nothing to fill: the surface encloses no volume")
    used, T = np.unique(T, return_inverse=True)
    return nodes[used], T.reshape(-1, 4)


def six_volumes(V: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return six times the signed volume (t,) of each tetrahedron."""
    return np.linalg.det(V[T[:, 1:]] - V[T[:, :1]])


def barycentric_coordinates(V: np.ndarray, T: np.ndarray, points: np.ndarray) -> csr_array:
    """Return the barycentric coordinates (q, p) of points in the tetrahedra that contain them.

    A point outside all tetrahedra uses the tetrahedron in which its least coordinate is largest.

    Parameters
    ----------
    V, T
        Tetrahedra of nonzero volume.
    points : (q, 3) float64
    """
    from scipy.spatial import cKDTree

    near = min(NEAR, len(T))
    _, candidate = cKDTree(V[T].mean(axis=1)).query(points, k=near)
    candidate = candidate.reshape(len(points), near)
    inverse = np.linalg.inv((V[T[:, 1:]] - V[T[:, :1]]).transpose(0, 2, 1))
    best, found = np.full(len(points), -np.inf), np.zeros((len(points), 4))
    tetrahedron = np.zeros(len(points), dtype=np.int64)
    for t in candidate.T:
        three = np.einsum("qij,qj->qi", inverse[t], points - V[T[t, 0]])
        coordinates = np.column_stack([1 - three.sum(axis=1), three])
        least = coordinates.min(axis=1)
        better = least > best
        best[better], found[better], tetrahedron[better] = least[better], coordinates[better], t[better]
    rows = np.repeat(np.arange(len(points)), 4)
    entries = (found.ravel(), (rows, T[tetrahedron].ravel()))
    return coo_array(entries, shape=(len(points), len(V))).tocsr()


def _components(n: int, T: np.ndarray) -> np.ndarray:
    i, j = T[:, [0, 0, 0]].ravel(), T[:, 1:].ravel()
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)[1]
