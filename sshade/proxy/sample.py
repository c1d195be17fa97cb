"""Build the proxy N of a mesh M: sample vertices of M and triangulate the dual of their Voronoi cells.

The vertices of N are samples, vertices of M. Every vertex of M belongs to the cell of its nearest sample.
Three cells that meet in a triangle of M make a triangle of N. Cells that are not discs would give N another
topology than M; more samples are added there (:mod:`sshade.proxy.closed_ball`).

F. Maggioli, D. Baieri, S. Melzi, E. Rodola, "ReMatching: low-resolution representations for scalable shape
correspondence", 2024.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.incidence import group_rows
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.problem.handle_checks import checked_index
from sshade.problem.options import Options
from sshade.proxy import coarse
from sshade.proxy.closed_ball import faces_of_three, refinements
from sshade.proxy.fronts import Fronts, farthest_point_sampling

#: Smallest number of proxy vertices besides the handles.
SPARE = 4
#: Number of handles that always find room on a proxy; more handles are thinned.
HANDLES = 1500
#: Least number of vertices of a mesh that is sampled from coarse to fine (:mod:`sshade.proxy.coarse`).
LARGE = 300_000


def least_vertices(handles: int) -> int:
    """Return the smallest number of proxy vertices for a number of handles."""
    return min(handles, HANDLES) + SPARE


def proxy_vertices(asked: int, n: int, handles: int = 0, *, coarser: int = Options.coarser) -> int:
    """Return how many vertices a proxy samples: `asked`, but of a small mesh at most ``n // coarser``.

    A proxy with more than a quarter of the vertices has no detail to leave out. Handles find room whatever
    the mesh's size: see :func:`least_vertices`.

    Parameters
    ----------
    asked : int
        Fewer vertices than handles are returned unchanged; the sampling thins the handles or refuses.
    n : int
        Vertices of the mesh.
    handles : int
        Handle vertices.
    coarser : int
        Smallest ratio of the mesh's vertices to the proxy's.
    """
    return min(asked, n, max(n // coarser, least_vertices(handles)))


def shared_vertices(asked: int, area: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Distribute proxy vertices over components by area, within the numbers that the components can use.

    Parameters
    ----------
    asked : int
        Wanted total.
    area : (c,) float64
        Of each component.
    least, most : (c,) int
        Smallest and largest number of each component. A component takes no more than its largest number; the
        rest goes to the other components.

    Returns
    -------
    (c,) int64
        Their sum is `asked` up to rounding, unless all components have their smallest or largest numbers.
    """
    share, free = np.array(least, dtype=np.float64), np.ones(len(area), dtype=bool)
    while (total := area[free].sum()) > 0:
        share[free] = (asked - share[~free].sum()) / total * area[free]
        low, high = free & (share < least), free & (share > most)
        # With more to give back than to add, the components at their largest numbers stay there.
        fixed = high if (share - most)[high].sum() >= (least - share)[low].sum() else low
        if not fixed.any():
            break
        share[fixed] = np.clip(share, least, most)[fixed]
        free &= ~fixed
    # Components without area have their smallest number.
    return np.round(np.clip(share, least, most)).astype(np.int64)


#: Largest number of rounds in which samples are added until all cells pass the closed-ball test.
MAX_ROUNDS = 50
#: What to do about a proxy that is too coarse. A small mesh has no more vertices unless `coarser` is lower.
MORE = "raise the option vertices, and on a small mesh lower the option coarser"


@dataclass(frozen=True, eq=False)
class Sampling:
    """The samples of a mesh M, their Voronoi cells, and the faces of the proxy N.

    Parameters
    ----------
    samples : (k,) int64
        Vertices of M that are the vertices of N; vertices that must be samples come first.
    faces : (l, 3) int64
        Faces of N, oriented like M, the smallest id of each face first.
    cell : (n,) int32
        For each vertex of M, the vertex of N whose cell contains it.
    distance : (n,) float64
        Distance along edges from each vertex of M to its sample, in the mesh's unit.
    added : int
        Number of samples that the closed-ball test added.
    """

    samples: np.ndarray
    faces: np.ndarray
    cell: np.ndarray
    distance: np.ndarray
    added: int = 0


def sample_proxy(
    mesh: Mesh,
    vertices: int,
    *,
    first: np.ndarray | None = None,
    seed: int | Sequence[int] = 0,
    graph: VertexGraph | None = None,
) -> Sampling:
    """Sample a mesh and triangulate the dual of the samples' Voronoi cells.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, consistently oriented, one component, with or without boundary.
    vertices : int
        Number of samples. The closed-ball test may add a few more.
    first : (h,) int, optional
        Vertices that must be samples. They become the first vertices of N, in this order.
    seed : int or sequence of int
        Chooses the random vertex that follows `first`; all further samples depend on it.
    graph : VertexGraph, optional
        :func:`sshade.mesh.adjacency.vertex_graph` of the mesh. Pass it to share it between samplings.

    Returns
    -------
    Sampling
        The faces form a manifold that uses every sample and has M's Euler characteristic, number of
        components and number of boundary loops.

    Raises
    ------
    InputError
        If the mesh is not as required, `vertices` is larger than its number of vertices or smaller than
        h, `first` repeats a vertex or is out of range, the seed is negative, or the proxy still has
        another topology than M after :data:`MAX_ROUNDS` rounds.
    """
    require_mesh(mesh, "sample_proxy")
    mesh.require_manifold()
    mesh.require_one_component()
    if vertices > mesh.n:
        raise InputError(
            f"{vertices} proxy vertices were asked for, but the mesh has only {mesh.n}; ask for fewer"
        )
    start = np.zeros(0, dtype=np.int64) if first is None or not len(first) else checked_index(first)
    if vertices < len(start):
        raise InputError(
            f"{vertices} proxy vertices cannot hold the {len(start)} handle vertices; ask for more"
        )
    if vertices > len(start):
        start = np.append(start, _random_other_vertex(mesh.n, start, seed))
    fronts = sample_farthest(mesh, graph or vertex_graph(mesh), vertices, first=start)
    rounds, sampled = 0, len(fronts)
    while True:
        new, failed = refinements(mesh.F, fronts)
        if len(failed) == 0:
            break
        if rounds == MAX_ROUNDS or len(new) == 0:
            raise InputError(
                f"remeshing to {vertices} vertices failed: after {rounds} rounds {len(failed)} cells "
                f"(around vertices {fronts.samples[failed[:3]].tolist()}) are no discs; {MORE}"
            )
        fronts.insert(new)
        rounds += 1
    result = Sampling(
        samples=fronts.samples,
        faces=_dual_faces(mesh.F, fronts.cell, len(fronts)),
        cell=fronts.cell,
        distance=fronts.distance,
        added=len(fronts) - sampled,
    )
    _check_topology(mesh, result)
    return result


def sample_farthest(mesh: Mesh, graph: VertexGraph, count: int, *, first: np.ndarray) -> Fronts:
    """Sample vertices by farthest points, beginning with `first`; large meshes from coarse to fine.

    Parameters
    ----------
    mesh : Mesh
        Its positions and area determine slabs and radii, but no distance.
    graph : VertexGraph
        Edges of the mesh; lengths may differ from the Euclidean ones.
    count : int
        Number of samples.
    first : (h,) int

    Raises
    ------
    InputError
        As :func:`sshade.proxy.fronts.farthest_point_sampling`.
    """
    if graph.n >= LARGE and coarse.has_room(graph.n, count, first):
        return coarse.sample_coarsely(mesh, graph, count, first=first)
    return farthest_point_sampling(graph, count, first=first)


def proxy_mesh(mesh: Mesh, sampling: Sampling) -> Mesh:
    """Return the proxy N as a mesh: the positions of the samples with the dual faces."""
    return Mesh(mesh.V[sampling.samples], sampling.faces)


def _random_other_vertex(n: int, taken: np.ndarray, seed: int | Sequence[int]) -> int:
    numbers = np.asarray(seed)
    if numbers.dtype.kind not in "iu" or (numbers < 0).any():
        raise InputError(f"a seed is 0 or a positive integer, or a tuple of them, not {seed!r}")
    rng = np.random.default_rng(seed)
    vertex = int(rng.integers(n - len(taken)))
    for other in np.sort(taken):  # turns a rank among the other vertices into a vertex
        vertex += int(other <= vertex)
    return vertex


def _dual_faces(F: np.ndarray, cell: np.ndarray, k: int) -> np.ndarray:
    """Return the triples (l, 3) of cells that meet in a triangle, oriented like it, smallest cell first."""
    corners = cell[F[faces_of_three(F, cell, k)[1]]].astype(np.int64)
    turn = corners.argmin(axis=1)[:, None] + np.arange(3)
    faces = np.take_along_axis(corners, turn % 3, axis=1)
    first, _ = group_rows(faces, k)
    return faces[np.sort(first)]


def _check_topology(mesh: Mesh, result: Sampling) -> None:
    """Raise InputError unless the proxy is a manifold with M's topology and uses every sample."""
    failed = f"remeshing to {len(result.samples)} vertices failed"
    try:
        proxy = proxy_mesh(mesh, result)
        proxy.require_manifold()
    except InputError as error:
        raise InputError(f"{failed}: {error}; {MORE}") from error
    if proxy.topology != mesh.topology:
        raise InputError(f"{failed}: the proxy has {proxy.topology}, the mesh {mesh.topology}; {MORE}")
