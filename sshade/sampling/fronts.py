"""Graph-geodesic fronts: farthest point sampling and the Voronoi regions of its samples.

Distances run along mesh edges, with Euclidean edge lengths, so that regions
are connected by construction (ReMatching: F. Maggioli, D. Baieri, S. Melzi,
E. Rodola, "ReMatching: low-resolution representations for scalable shape
correspondence", 2024). Inserting a sample updates only what lies nearer to it
than to every older one; k samples cost O(n log n log k) in expectation.
"""

from __future__ import annotations

from heapq import heapify, heappop, heapreplace
from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.errors import InputError
from sshade.mesh.adjacency import VertexGraph

#: Candidates for the next farthest vertex are gathered down to the first fraction of the largest distance
#: and, of these, queued down to the second: most are covered before their turn, and need no queue.
_GATHERED, _QUEUED = 0.8, 0.97
#: Width of the bands in which fronts advance, in mean edge lengths; any positive one gives the same result.
_BAND_EDGES = 4.0

NOWHERE, NEAR, FAR = 0, 1, 2


class _State(NamedTuple):
    """The graph, the regions so far, and the queues of the fronts that change them.

    Vertices are unsigned here: without the test for negative indices, which numba counts from the end,
    fronts take two thirds of the time.

    Attributes
    ----------
    indptr, indices, lengths : (n + 1,) uint32, (2e,) uint32, (2e,) float64
        See :class:`VertexGraph`.
    width : float
        Width of a band, in the unit of length.
    distance, region : (n,) float64 and (n,) int32
    queued : (n,) uint8
        Which of the two queues a vertex is in, if any.
    near : (r,) uint32
        A ring of the vertices in the band at work; r is a power of two above n.
    far : (n,) uint32
        Those for later bands.
    """

    indptr: np.ndarray
    indices: np.ndarray
    lengths: np.ndarray
    width: float
    distance: np.ndarray
    region: np.ndarray
    queued: np.ndarray
    near: np.ndarray
    far: np.ndarray


class Fronts:
    """Voronoi regions of a growing set of samples.

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
        self._state = _State(
            indptr=_unsigned(graph.indptr),
            indices=_unsigned(graph.indices),
            lengths=graph.lengths,
            width=_BAND_EDGES * float(graph.lengths.mean()),
            distance=np.full(graph.n, np.inf),
            region=np.full(graph.n, -1, dtype=np.int32),
            queued=np.zeros(graph.n, dtype=np.uint8),
            near=np.empty(1 << graph.n.bit_length(), dtype=np.uint32),
            far=np.empty(graph.n, dtype=np.uint32),
        )
        _start(self._state, first)

    def __len__(self) -> int:
        return sum(len(part) for part in self._samples)

    @property
    def samples(self) -> np.ndarray:
        """(k,) int64 vertex ids of the samples, in order of insertion."""
        return np.concatenate(self._samples)

    @property
    def region(self) -> np.ndarray:
        """(n,) int32 for each vertex the sample (its position in `samples`) that is nearest."""
        return self._state.region

    @property
    def distance(self) -> np.ndarray:
        """(n,) float64 graph distance of each vertex to its sample."""
        return self._state.distance

    def insert(self, vertices: np.ndarray) -> None:
        """Insert vertices as samples, in the given order; none may be a sample already."""
        vertices = np.asarray(vertices, dtype=np.int64)
        _insert(self._state, vertices, len(self))
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
        self._samples.append(_insert_farthest(self._state, count, len(self), among))


def _unsigned(ids: np.ndarray) -> np.ndarray:
    return ids.astype(np.int32, copy=False).view(np.uint32)


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


@njit(cache=True, nogil=True)
def _advance(state, size):
    """Relax the distances of all that is nearer to the first `size` entries of `near` than to its sample.

    Delta-stepping: labels are corrected in bands of equal width, in any order within a band; a
    vertex may be visited again, but no heap is kept, which would cost several times as much. The
    labels end the same to the last bit: each is the minimum of sums taken from the samples
    outwards, and ties go to the smaller sample.

    U. Meyer, P. Sanders, "Delta-stepping: a parallelizable shortest path algorithm", 2003.
    """
    indptr, indices, lengths = state.indptr, state.indices, state.lengths
    distance, region, queued, near, far = state.distance, state.region, state.queued, state.near, state.far
    one, mask = np.uint64(1), np.uint64(near.shape[0] - 1)  # with a signed number they would be floats
    head, tail, waiting, limit = np.uint64(0), np.uint64(size), np.uint64(0), state.width
    while head != tail:
        while head != tail:
            u = near[head]
            head = (head + one) & mask
            queued[u] = NOWHERE
            d, s = distance[u], region[u]
            for p in range(indptr[u], indptr[u + one]):
                w = indices[p]
                nd = d + lengths[p]
                if nd < distance[w] or (nd == distance[w] and s < region[w]):
                    distance[w] = nd
                    region[w] = s
                    if nd < limit:
                        if queued[w] != NEAR:
                            queued[w] = NEAR
                            near[tail] = w
                            tail = (tail + one) & mask
                    elif queued[w] == NOWHERE:
                        queued[w] = FAR
                        far[waiting] = w
                        waiting += one
        # The next band begins at the nearest vertex that waits.
        nearest = np.inf
        for q in range(waiting):
            if queued[far[q]] == FAR and distance[far[q]] < nearest:
                nearest = distance[far[q]]
        limit = nearest + state.width
        kept = np.uint64(0)
        for q in range(waiting):
            w = far[q]
            if queued[w] != FAR:
                continue  # it got nearer and was dealt with
            if distance[w] < limit:
                queued[w] = NEAR
                near[tail] = w
                tail = (tail + one) & mask
            else:
                far[kept] = w
                kept += one
        waiting = kept


@njit(cache=True, nogil=True)
def _start(state, first):
    for s in range(first.shape[0]):
        _place(state, first[s], s, s)
    _advance(state, first.shape[0])


@njit(cache=True, nogil=True)
def _insert(state, vertices, sample):
    for i in range(vertices.shape[0]):
        _place(state, vertices[i], sample + i, 0)
        _advance(state, 1)


@njit(cache=True, nogil=True)
def _place(state, vertex, sample, position):
    """Make a vertex a sample, from which the next front begins."""
    state.distance[vertex] = 0.0
    state.region[vertex] = sample
    state.near[position] = vertex


@njit(cache=True, nogil=True)
def _largest(distance, vertices):
    largest = 0.0
    for v in vertices:
        largest = max(largest, distance[v])
    return largest


@njit(cache=True, nogil=True)
def _from(distance, vertices, low):
    """Those of some vertices whose distance is `low` or more."""
    found, count = np.empty(len(vertices), dtype=np.int64), 0
    for v in vertices:
        if distance[v] >= low:
            found[count] = v
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _insert_farthest(state, count, sample, among):
    distance = state.distance
    samples = np.empty(count, dtype=np.int64)
    # Distances only shrink, so an entry of the heap is an upper bound: it is brought up to date
    # when it comes to the top. The heap holds the farthest vertices alone, (-distance, vertex), and is
    # filled anew when they are used up, from all those down to `lowest`, until they are.
    gathered, lowest = among[:0], np.inf
    heap, low = [(0.0, among[0]) for _ in range(0)], np.inf
    for i in range(count):
        while True:
            if len(heap) == 0:
                gathered = _from(distance, gathered, lowest)
                if len(gathered) == 0:
                    lowest = _GATHERED * _largest(distance, among)
                    gathered = _from(distance, among, lowest)
                low = max(lowest, _QUEUED * _largest(distance, gathered))
                heap = [(-distance[v], v) for v in _from(distance, gathered, low)]
                heapify(heap)
            key, v = heap[0]
            d = distance[v]
            if d == -key:
                break
            if d >= low:
                heapreplace(heap, (-d, v))
            else:
                heappop(heap)
        samples[i] = v
        _place(state, v, sample + i, 0)
        _advance(state, 1)
    return samples
