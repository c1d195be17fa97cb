"""Graph-geodesic fronts: farthest point sampling and the Voronoi cells of its samples.

Distances run along mesh edges, with Euclidean edge lengths, so that cells
are connected by construction (ReMatching: F. Maggioli, D. Baieri, S. Melzi,
E. Rodola, "ReMatching: low-resolution representations for scalable shape
correspondence", 2024). Inserting a sample updates only what lies nearer to it
than to every older one; k samples cost O(n log n log k) in expectation.
"""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.adjacency import VertexGraph
from sshade.sampling import advance

#: Width of the bands in which fronts advance, in mean edge lengths; any positive one gives the same result.
_BAND_EDGES = 4.0


class Fronts:
    """Voronoi cells of a growing set of samples.

    Parameters
    ----------
    graph : VertexGraph
    first : (h,) int
        Samples to begin with, inserted in one multi-source front; ties of
        distance go to the earlier one, as they would one at a time.

    Raises
    ------
    InputError
        When `first` is empty, repeats a vertex, or is out of range.
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
        """The fronts of some samples (k,) that have advanced as far as they go."""
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
        """(n,) int32 for each vertex the sample (its position in `samples`) that is nearest."""
        return self._state.cell

    @property
    def distance(self) -> np.ndarray:
        """(n,) float64 graph distance of each vertex to its sample."""
        return self._state.distance

    def insert(self, vertices: np.ndarray) -> None:
        """Insert vertices as samples, in the given order; none may be a sample already."""
        vertices = np.asarray(vertices, dtype=np.int64)
        advance.insert(self._state, vertices, len(self) + np.arange(len(vertices)))
        self._samples.append(vertices)

    def insert_farthest(self, count: int, *, among: np.ndarray | None = None) -> None:
        """Insert `count` samples, each the vertex farthest from all before it.

        Of several at the same distance the smallest id is taken.

        Parameters
        ----------
        count : int
            So many must be left.
        among : (a,) int, optional
            The vertices to choose from, in ascending order; by default all.
        """
        among = np.arange(self.graph.n) if among is None else among
        self._samples.append(advance.insert_farthest(self._state, count, len(self), among))


def band(graph: VertexGraph) -> float:
    """Width of the bands in which fronts advance on a graph."""
    return _BAND_EDGES * float(graph.lengths.mean())


def thinned(graph: VertexGraph, vertices: np.ndarray, count: int) -> np.ndarray:
    """At most `count` of some vertices, each the one farthest from those before it.

    Parameters
    ----------
    graph : VertexGraph
    vertices : (h,) int
        Each once.
    count : int
        With no fewer, they come back as they are.

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
    """Sample `count` vertices, beginning with `first`.

    Raises
    ------
    InputError
        When `count` exceeds the number of vertices or is under the number of first samples.
    """
    if count > graph.n:
        raise InputError(f"{count} samples were asked for, but the mesh has only {graph.n} vertices")
    if count < len(first):
        raise InputError(f"{count} samples cannot hold the {len(first)} given first ones; ask for more")
    fronts = Fronts(graph, first)
    fronts.insert_farthest(count - len(first))
    return fronts
