"""Remeshing by sampling: the proxy N is the dual of geodesic Voronoi cells of M.

F. Maggioli, D. Baieri, S. Melzi, E. Rodola, "ReMatching: low-resolution
representations for scalable shape correspondence", 2024. The vertices of N are
vertices of M, and every vertex of M belongs to the cell of one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sshade.errors import InputError
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.sampling.closed_ball import faces_of_three, group_rows, refinements
from sshade.sampling.coarse import sample

#: Rounds of closed-ball refinement after which remeshing gives up.
MAX_ROUNDS = 50


@dataclass(frozen=True, eq=False)
class Sampling:
    """A proxy N of a mesh M, with what links the two.

    Parameters
    ----------
    samples : (k,) int64
        Vertex of M that each vertex of N is; the given first ones come first.
    faces : (l, 3) int64
        Faces of N, oriented as M, each with its smallest id first.
    cell : (n,) int32
        For each vertex of M the vertex of N whose cell it is in.
    distance : (n,) float64
        Graph distance of each vertex of M to that sample.
    rounds : int
        Rounds of closed-ball refinement that added samples.
    added : int
        Samples added by them.
    """

    samples: np.ndarray
    faces: np.ndarray
    cell: np.ndarray
    distance: np.ndarray
    rounds: int = 0
    added: int = 0


def sample_proxy(
    mesh: Mesh,
    vertices: int,
    *,
    first: np.ndarray | None = None,
    seed: int | Sequence[int] = 0,
    graph: VertexGraph | None = None,
) -> Sampling:
    """Sample a mesh and triangulate the dual of the samples' cells.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, consistently oriented, one component; boundary loops are fine.
    vertices : int
        Number of samples, before refinement adds the few that the topology needs.
    first : (h,) int, optional
        Vertices that must be samples; they get the first ids, in this order.
    seed : int or sequence of int
        Chooses the random vertex that follows them, on which the rest depends.
    graph : VertexGraph, optional
        The mesh's :func:`sshade.mesh.adjacency.vertex_graph`, where several remeshes share it.

    Returns
    -------
    Sampling
        Its faces form a manifold with M's Euler characteristic, number of
        components and boundary loops, and use every sample.

    Raises
    ------
    InputError
        When the mesh is not as required, `vertices` exceeds its number of
        vertices or is below the number of first ones, `first` repeats a vertex
        or is out of range, the seed is negative, or refinement ends without a
        proxy of M's topology.
    """
    mesh.require_manifold()
    mesh.require_one_component()
    if vertices > mesh.n:
        raise InputError(
            f"{vertices} proxy vertices were asked for, but the mesh has only {mesh.n}; ask for fewer"
        )
    start = np.zeros(0, dtype=np.int64) if first is None else np.asarray(first, dtype=np.int64)
    if vertices < len(start):
        raise InputError(
            f"{vertices} proxy vertices cannot hold the {len(start)} handle vertices; ask for more"
        )
    if vertices > len(start):
        start = np.append(start, _random_other_vertex(mesh.n, start, seed))
    fronts = sample(mesh, graph or vertex_graph(mesh), vertices, first=start)
    rounds, sampled = 0, len(fronts)
    while True:
        new, failed = refinements(mesh.F, fronts)
        if len(failed) == 0:
            break
        if rounds == MAX_ROUNDS or len(new) == 0:
            raise InputError(
                f"remeshing to {vertices} vertices failed: after {rounds} rounds {len(failed)} cells "
                f"(around vertices {fronts.samples[failed[:3]].tolist()}) are no discs; ask for more vertices"
            )
        fronts.insert(new)
        rounds += 1
    result = Sampling(
        samples=fronts.samples,
        faces=_dual_faces(mesh.F, fronts.cell, len(fronts)),
        cell=fronts.cell,
        distance=fronts.distance,
        rounds=rounds,
        added=len(fronts) - sampled,
    )
    _check_topology(mesh, result)
    return result


def proxy_mesh(mesh: Mesh, sampling: Sampling) -> Mesh:
    """The proxy N as a mesh: the samples' positions with the dual faces."""
    return Mesh(mesh.V[sampling.samples], sampling.faces)


def _random_other_vertex(n: int, taken: np.ndarray, seed: int | Sequence[int]) -> int:
    try:
        rng = np.random.default_rng(seed)
    except ValueError as error:
        raise InputError(f"seed {np.min(seed)} is negative; use 0 or a positive integer") from error
    vertex = int(rng.integers(n - len(taken)))
    for other in np.sort(taken):  # the vertex of that rank among those not taken
        vertex += int(other <= vertex)
    return vertex


def _dual_faces(F: np.ndarray, cell: np.ndarray, k: int) -> np.ndarray:
    """(l, 3) triples of k cells that meet in a triangle, oriented as it, smallest first, each once."""
    corners = cell[F[faces_of_three(F, cell, k)[1]]].astype(np.int64)
    turn = corners.argmin(axis=1)[:, None] + np.arange(3)
    faces = np.take_along_axis(corners, turn % 3, axis=1)
    first, _ = group_rows(faces, k)
    return faces[np.sort(first)]


def _check_topology(mesh: Mesh, result: Sampling) -> None:
    """Raise InputError unless the proxy is a manifold of M's topology that uses every sample."""
    hint = "ask for more vertices"
    try:
        proxy = proxy_mesh(mesh, result)
        proxy.require_manifold()
    except InputError as error:
        raise InputError(f"remeshing to {len(result.samples)} vertices failed: {error}; {hint}") from error
    if proxy.topology != mesh.topology:
        raise InputError(
            f"remeshing to {len(result.samples)} vertices failed: the proxy has {proxy.topology}, "
            f"the mesh {mesh.topology}; {hint}"
        )
