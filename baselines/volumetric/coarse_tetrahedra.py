"""Coarse tetrahedra inside a closed surface, which carry it by barycentric coordinates.

The surface is sampled as for a proxy first, as fTetWild's time grows with its input; then fTetWild fills it,
and takes self-intersections of the input as they come: what touches within its envelope grows together.
It draws at random from what no seed decides, so that another process gets other tetrahedra; within one they
are kept, also for the mesh moved or scaled.
Every vertex of the mesh lies in a tetrahedron, or beside one, whose barycentric coordinates it keeps.

Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral meshing in the wild", 2020; pytetwild.
"""

from __future__ import annotations

import hashlib
import logging
import signal
import subprocess
import sys
from collections import OrderedDict
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TypedDict

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.sampling.proxy import proxy_mesh, sample_proxy

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

log = logging.getLogger(__name__)

#: Coordinates are rounded to this (x diagonal): meshes that differ by rounding have the same tetrahedra.
GRID = 2.0**-23
#: Tetrahedra near a vertex of the surface among which the one is that carries it.
NEAR = 32
#: Meshes whose tetrahedra are kept.
KEPT = 8
#: Energy and number of steps at which fTetWild stops improving the tetrahedra; its own are 10 and 80.
STOP_ENERGY, STEPS = 20.0, 20

#: Seconds of a core after which it is stopped, where the system has such limits.
LIMIT = 600

#: fTetWild in a process of its own: it writes files where it runs, ends where it fails, and knows no limit.
FILL = """
import sys
import numpy as np
from pytetwild import tetrahedralize
edge, envelope, energy, steps, limit = map(float, sys.argv[1:])
if limit:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit)))
surface = np.load("surface.npz", allow_pickle=False)
nodes, T = tetrahedralize(
    surface["V"], surface["F"], edge_length_fac=edge, epsilon=envelope,
    stop_energy=energy, num_opt_iter=int(steps), num_threads=1,
)[:2]
np.savez("filled.npz", nodes=nodes, T=T)
"""

_kept: OrderedDict[tuple[object, ...], CoarseTetrahedra] = OrderedDict()


class TetrahedraOptions(TypedDict, total=False):
    """How coarse the tetrahedra are.

    Attributes
    ----------
    samples : int
        Vertices of the surface that is filled; a mesh of no more is filled itself.
    edge : float
        Length of the edges inside (x diagonal) that is aimed at.
    envelope : float
        How far (x diagonal) the surface of the tetrahedra may lie from that of the samples.
    """

    samples: int
    edge: float
    envelope: float


@dataclass(frozen=True, eq=False)
class CoarseTetrahedra:
    """Tetrahedra around a mesh.

    Attributes
    ----------
    V : (p, 3) float64
        Nodes, in the mesh's coordinates.
    T : (t, 4) int64
        Of positive volume.
    volumes : (t,) float64
    carry : (n, p) sparse float64
        Barycentric coordinates of the mesh's vertices, four a row: ``carry @ V`` are its vertices.
    component : (p,) int
        Which nodes hang together.
    seconds : float
        That it took to make them.
    """

    V: np.ndarray
    T: np.ndarray
    volumes: np.ndarray
    carry: csr_array
    component: np.ndarray
    seconds: float

    def facts(self) -> dict[str, float]:
        """For the row of a run; they are made once a mesh and process, whichever run that falls to."""
        return {
            "nodes": len(self.V),
            "tetrahedra": len(self.T),
            "tetrahedra_seconds": self.seconds,
        }


def coarse_tetrahedra(
    mesh: Mesh, *, samples: int = 3000, edge: float = 0.04, envelope: float = 1e-3
) -> CoarseTetrahedra:
    """Fill a surface with tetrahedra; those of the last meshes are kept, and hold for them moved or scaled.

    Parameters
    ----------
    mesh : Mesh
        Closed. It may intersect itself and have several components; one of more vertices than `samples`
        must be manifold and oriented.
    samples, edge, envelope
        See :class:`TetrahedraOptions`.

    Raises
    ------
    ImportError
        When pytetwild is not installed.
    InputError
        When the surface has a boundary, encloses nothing that could be filled, or cannot be sampled.
    """
    if len(mesh.boundary_edges):
        raise InputError(
            f"tetrahedra fill closed surfaces, and this one has {len(mesh.boundary_edges)} boundary edges; "
            "close its holes, or take a method of surfaces"
        )
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    rounded = np.round((mesh.V - centre) / (scale * GRID)) * GRID + 0.0  # no negative zeros
    key = (hashlib.sha256(rounded.tobytes() + mesh.F.tobytes()).digest(), samples, edge, envelope)
    if key in _kept:
        _kept.move_to_end(key)
    else:
        _kept[key] = _made(Mesh(rounded, mesh.F), samples, edge=edge, envelope=envelope)
    while len(_kept) > KEPT:
        _kept.popitem(last=False)
    kept = _kept[key]
    return replace(
        kept,
        V=kept.V * scale + centre,
        volumes=kept.volumes * scale**3,
        carry=barycentric_coordinates(kept.V, kept.T, (mesh.V - centre) / scale),
    )


def _made(mesh: Mesh, samples: int, *, edge: float, envelope: float) -> CoarseTetrahedra:
    """Of a mesh about the origin, of diagonal 1."""
    begin = perf_counter()
    V, T = _filled(*_sampled(mesh, samples), edge=edge, envelope=envelope)
    return CoarseTetrahedra(
        V=V,
        T=T,
        volumes=np.linalg.det(V[T[:, 1:]] - V[T[:, :1]]) / 6,
        carry=csr_array((mesh.n, len(V))),
        component=_components(len(V), T),
        seconds=perf_counter() - begin,
    )


def _sampled(mesh: Mesh, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """V (s, 3) and F (g, 3) of proxies of all components, with samples by area."""
    if samples >= mesh.n:
        return np.array(mesh.V), np.array(mesh.F)
    areas = np.bincount(mesh.component[mesh.F[:, 0]], mesh.face_areas)
    V, F, count = [], [], 0
    for component in np.unique(mesh.component[mesh.F[:, 0]]):
        own = np.flatnonzero(mesh.component == component)
        faces = np.searchsorted(own, mesh.F[mesh.component[mesh.F[:, 0]] == component])
        part = Mesh(mesh.V[own], faces)
        share = max(round(samples * areas[component] / mesh.area), 4)
        if share < part.n:
            part = proxy_mesh(part, sample_proxy(part, share))
        V.append(part.V)
        F.append(part.F + count)
        count += part.n
    return np.concatenate(V), np.concatenate(F)


def _filled(V: np.ndarray, F: np.ndarray, *, edge: float, envelope: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and positive tetrahedra of fTetWild."""
    if find_spec("pytetwild") is None:
        raise ImportError("tetrahedra need pytetwild; pip install 'sshade[tet]'")
    if resource is None:
        log.warning("this system has no limits of processor time: fTetWild takes as long as it takes")
    with TemporaryDirectory() as folder:
        np.savez(Path(folder, "surface.npz"), V=V, F=F.astype(np.int32))
        sizes = (edge, envelope, STOP_ENERGY, STEPS, LIMIT if resource else 0)
        done = subprocess.run(
            [sys.executable, "-c", FILL, *map(str, sizes)], cwd=folder, capture_output=True, text=True
        )
        if done.returncode:
            raise InputError(f"fTetWild could not fill the surface: {_why(done)}")
        with np.load(Path(folder, "filled.npz"), allow_pickle=False) as filled:
            nodes, T = filled["nodes"], filled["T"]
    T = np.asarray(T, dtype=np.int64).reshape(-1, 4)
    volumes = np.linalg.det(nodes[T[:, 1:]] - nodes[T[:, :1]])
    T = np.where((volumes < 0)[:, None], T[:, [0, 2, 1, 3]], T)[volumes != 0]
    if len(T) == 0:
        raise InputError("fTetWild found nothing to fill: the surface encloses no volume")
    used, T = np.unique(T, return_inverse=True)
    return nodes[used], T.reshape(-1, 4)


def _why(done: subprocess.CompletedProcess[str]) -> str:
    if resource and done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"it was stopped, as after {LIMIT} s of a core or where memory runs out"
    said = done.stderr.strip().splitlines()
    return said[-1] if said else f"its process ended with {done.returncode}"


def barycentric_coordinates(V: np.ndarray, T: np.ndarray, points: np.ndarray) -> csr_array:
    """(q, p) coordinates of points (q, 3) in the tetrahedron that they lie in, or least far out of.

    Parameters
    ----------
    V, T
        Tetrahedra, none without volume.
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
        own = np.column_stack([1 - three.sum(axis=1), three])
        least = own.min(axis=1)
        better = least > best
        best[better], found[better], tetrahedron[better] = least[better], own[better], t[better]
    rows = np.repeat(np.arange(len(points)), 4)
    entries = (found.ravel(), (rows, T[tetrahedron].ravel()))
    return coo_array(entries, shape=(len(points), len(V))).tocsr()


def _components(n: int, T: np.ndarray) -> np.ndarray:
    i, j = T[:, [0, 0, 0]].ravel(), T[:, 1:].ravel()
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)[1]
