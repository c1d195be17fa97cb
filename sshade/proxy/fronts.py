"""Farthest point sampling of a mesh, and the Voronoi cells of the samples.

Distances run along mesh edges, with Euclidean edge lengths; cells are therefore connected. A new sample
updates only the vertices that are nearer to it than to every older sample. k samples cost O(n log n log k)
in expectation.

F. Maggioli, D. Baieri, S. Melzi, E. Rodola, "ReMatching: low-resolution representations for scalable shape
correspondence", 2024.
"""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.mesh.adjacency import VertexGraph
from sshade.proxy import advance

#: Width of the bands in which fronts advance, in mean edge lengths. It changes the speed, not the result.
_BAND_EDGES = 4.0


class Fronts:
    """Voronoi cells of a growing set of samples.

    Parameters
    ----------
    graph : VertexGraph
        Edges of the mesh with their lengths.
    first : (h,) int
        Initial samples; h must be 1 or more. Vertices at equal distance belong to the earlier sample.

    Raises
    ------
    InputError
        If `first` is empty, repeats a vertex or is out of range, or all vertices coincide.
    """

    def __init__(self, graph: VertexGraph, first: np.ndarray) -> None:
        first = np.asarray(first, dtype=np.int64)
        if len(first) == 0:
            raise InputError("farthest point sampling needs a vertex to begin with")
        if first.min() < 0 or first.max() >= graph.n:
            raise InputError(f"sample ids must lie in 0..{graph.n - 1}")
        if len(np.unique(first)) < len(first):
            raise InputError("the first samples repeat a vertex")
        self.graph = graph
        if not graph.lengths.any():
            raise InputError("all vertices of the mesh coincide")
        self._samples = [first]
        self._state = advance.State.of(
            graph,
            width=band(graph),
            distance=np.full(graph.n, np.inf),
            cell=np.full(graph.n, -1, dtype=np.int32),
        )
        advance.start(self._state, first)

    @classmethod
    def advanced(cls, graph: VertexGraph, samples: np.ndarray, state: advance.State) -> Fronts:
        """Return fronts of samples (k,) whose cells and distances are complete in `state`."""
        fronts = cls.__new__(cls)
        fronts.graph, fronts._samples, fronts._state = graph, [samples], state
        return fronts

    def __len__(self) -> int:
        return sum(len(part) for part in self._samples)

    @property
    def samples(self) -> np.ndarray:
        """(k,) int64 vertex ids of the samples, in order of insertion."""
        return np.concatenate(self._samples)

    @property
    def cell(self) -> np.ndarray:
        """(n,) int32 cell of each vertex: the position in `samples` of its nearest sample."""
        return self._state.cell

    @property
    def distance(self) -> np.ndarray:
        """(n,) float64 graph distance of each vertex to its sample."""
        return self._state.distance

    def insert(self, vertices: np.ndarray) -> None:
        """Insert vertices (k,) as samples, in this order. None of them may be a sample already."""
        vertices = np.asarray(vertices, dtype=np.int64)
        advance.insert(self._state, vertices, len(self) + np.arange(len(vertices)))
        self._samples.append(vertices)

    def insert_farthest(self, count: int, *, among: np.ndarray | None = None) -> None:
        """Insert `count` samples, each the vertex farthest from all samples before it.

        Among equally far vertices the smallest id is taken.

        Parameters
        ----------
        count : int
            Number of samples; at most as many as vertices of `among` that are no samples yet.
        among : (a,) int, optional
            Candidates in ascending order; by default all vertices.
        """
        among = np.arange(self.graph.n) if among is None else among
        self._samples.append(advance.insert_farthest(self._state, count, len(self), among))


def band(graph: VertexGraph) -> float:
    """Return the width of the bands in which fronts advance on a graph, in its unit of length."""
    return _BAND_EDGES * float(graph.lengths.mean())


def thinned(graph: VertexGraph, vertices: np.ndarray, count: int) -> np.ndarray:
    """Choose at most `count` of some vertices, each the vertex farthest from those chosen before it.

    Parameters
    ----------
    graph : VertexGraph
    vertices : (h,) int
        Distinct vertices. The first is always chosen.
    count : int
        If at least h, `vertices` are returned themselves.

    Returns
    -------
    (min(h, count),) int64
    """
    if len(vertices) <= count:
        return vertices
    fronts = Fronts(graph, vertices[:1])
    fronts.insert_farthest(count - 1, among=np.sort(vertices))
    return fronts.samples


def farthest_point_sampling(graph: VertexGraph, count: int, *, first: np.ndarray) -> Fronts:
    """Sample `count` vertices, beginning with the vertices `first` (h,).

    Raises
    ------
    InputError
        If `count` is larger than the number of vertices or smaller than h, or as :class:`Fronts`.
    """
    if count > graph.n:
        raise InputError(
            f"{counted(count, 'sample was', 'samples were')} asked for, but the mesh has only {graph.n} "
            "vertices"
        )
    if count < len(first):
        raise InputError(
            f"{counted(count, 'sample', 'samples')} cannot hold {len(first)} given first ones; ask for more"
        )
    fronts = Fronts(graph, first)
    fronts.insert_farthest(count - len(first))
    return fronts
