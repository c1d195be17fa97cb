"""Graph-geodesic fronts: farthest point sampling and the Voronoi regions of its samples.

Distances run along mesh edges, with Euclidean edge lengths, so that regions
are connected by construction (ReMatching: F. Maggioli, D. Baieri, S. Melzi,
E. Rodola, "ReMatching: low-resolution representations for scalable shape
correspondence", 2024). Inserting a sample updates only what lies nearer to it
than to every older one; k samples cost O(n log n log k) in expectation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.errors import InputError
from sshade.mesh import Mesh

#: Candidates for the next farthest vertex are gathered down to this fraction of the largest distance.
_BAND = 0.7


@dataclass(frozen=True, eq=False)
class VertexGraph:
    """The edges of a mesh as a compressed sparse row structure.

    Parameters
    ----------
    indptr : (n + 1,) int32
    indices : (2e,) int32
        Neighbours of each vertex, in ascending order.
    lengths : (2e,) float64
        Euclidean edge lengths.
    boundary : (2e,) bool
        True where the edge has a single face.
    """

    indptr: np.ndarray
    indices: np.ndarray
    lengths: np.ndarray
    boundary: np.ndarray

    @property
    def n(self) -> int:
        """Number of vertices."""
        return len(self.indptr) - 1


def vertex_graph(mesh: Mesh) -> VertexGraph:
    """The edge graph of a mesh; O(n)."""
    return VertexGraph(*_vertex_graph(mesh.V, mesh.F))


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
        self._samples = [first]
        self._distance = np.full(graph.n, np.inf)
        self._region = np.full(graph.n, -1, dtype=np.int32)
        _start_fronts(graph.indptr, graph.indices, graph.lengths, first, self._distance, self._region)

    def __len__(self) -> int:
        return sum(len(part) for part in self._samples)

    @property
    def samples(self) -> np.ndarray:
        """(k,) int64 vertex ids of the samples, in order of insertion."""
        return np.concatenate(self._samples)

    @property
    def region(self) -> np.ndarray:
        """(n,) int32 for each vertex the sample (its position in `samples`) that is nearest."""
        return self._region

    @property
    def distance(self) -> np.ndarray:
        """(n,) float64 graph distance of each vertex to its sample."""
        return self._distance

    def insert(self, vertices: np.ndarray) -> None:
        """Insert vertices as samples, in the given order; none may be a sample already."""
        vertices = np.asarray(vertices, dtype=np.int64)
        graph = self.graph
        _insert(
            graph.indptr,
            graph.indices,
            graph.lengths,
            vertices,
            len(self),
            self._distance,
            self._region,
        )
        self._samples.append(vertices)

    def insert_farthest(self, count: int) -> None:
        """Insert `count` samples, each the vertex farthest from all before it.

        Of several at the same distance the smallest id is taken.

        Raises
        ------
        InputError
            When fewer vertices than that lie apart from the samples.
        """
        graph = self.graph
        samples = _insert_farthest(
            graph.indptr,
            graph.indices,
            graph.lengths,
            count,
            len(self),
            self._distance,
            self._region,
        )
        if len(samples) < count:
            raise InputError(
                f"only {len(self) + len(samples)} vertices lie at different places; "
                "ask for fewer samples, or weld coincident vertices with --repair"
            )
        self._samples.append(samples)


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
def _vertex_graph(V, F):
    n, m = V.shape[0], F.shape[0]
    start = np.zeros(n + 1, dtype=np.int32)
    for f in range(m):
        for c in range(3):
            start[F[f, c] + 1] += 2
    for i in range(n):
        start[i + 1] += start[i]
    # Each face lists, at each corner, its two neighbours: an edge of two faces comes twice.
    listed = np.empty(start[n], dtype=np.int32)
    fill = start[:-1].copy()
    for f in range(m):
        for c in range(3):
            i = F[f, c]
            listed[fill[i]] = F[f, (c + 1) % 3]
            listed[fill[i] + 1] = F[f, (c + 2) % 3]
            fill[i] += 2

    indptr = np.zeros(n + 1, dtype=np.int32)
    for i in range(n):
        begin, end = start[i], start[i + 1]
        for p in range(begin + 1, end):
            key, q = listed[p], p - 1
            while q >= begin and listed[q] > key:
                listed[q + 1] = listed[q]
                q -= 1
            listed[q + 1] = key
        distinct = 0
        for p in range(begin, end):
            if p == begin or listed[p] != listed[p - 1]:
                distinct += 1
        indptr[i + 1] = indptr[i] + distinct

    indices = np.empty(indptr[n], dtype=np.int32)
    lengths = np.empty(indptr[n], dtype=np.float64)
    boundary = np.empty(indptr[n], dtype=np.bool_)
    for i in range(n):
        out = indptr[i] - 1
        for p in range(start[i], start[i + 1]):
            j = listed[p]
            if p > start[i] and j == listed[p - 1]:
                boundary[out] = False
                continue
            out += 1
            indices[out] = j
            boundary[out] = True
            dx, dy, dz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
            lengths[out] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return indptr, indices, lengths, boundary


@njit(cache=True, nogil=True)
def _push(keys, ids, size, key, v):
    """Add to a binary min-heap of `size` entries; return the new size."""
    p = size
    while p > 0:
        parent = (p - 1) >> 1
        if keys[parent] <= key:
            break
        keys[p], ids[p] = keys[parent], ids[parent]
        p = parent
    keys[p], ids[p] = key, v
    return size + 1


@njit(cache=True, nogil=True)
def _pop(keys, ids, size):
    """Remove the root of a binary min-heap of `size` entries; return the new size."""
    size -= 1
    key, v = keys[size], ids[size]
    p = 0
    while True:
        child = 2 * p + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[p], ids[p] = keys[child], ids[child]
        p = child
    keys[p], ids[p] = key, v
    return size


@njit(cache=True, nogil=True)
def _grown(array, size):
    if size < array.shape[0]:
        return array
    larger = np.empty(2 * array.shape[0], dtype=array.dtype)
    larger[:size] = array[:size]
    return larger


@njit(cache=True, nogil=True)
def _advance(indptr, indices, lengths, distance, region, keys, ids, size):
    """Dijkstra from the entries of the heap, only into what gets nearer; return the heap's arrays."""
    while size > 0:
        d, u = keys[0], ids[0]
        size = _pop(keys, ids, size)
        if d > distance[u]:
            continue
        s = region[u]
        for p in range(indptr[u], indptr[u + 1]):
            w = indices[p]
            nd = d + lengths[p]
            if nd < distance[w] or (nd == distance[w] and s < region[w]):
                distance[w] = nd
                region[w] = s
                keys, ids = _grown(keys, size), _grown(ids, size)
                size = _push(keys, ids, size, nd, w)
    return keys, ids


@njit(cache=True, nogil=True)
def _start_fronts(indptr, indices, lengths, first, distance, region):
    keys = np.empty(first.shape[0] + 1024, dtype=np.float64)
    ids = np.empty(first.shape[0] + 1024, dtype=np.int32)
    for s in range(first.shape[0]):
        distance[first[s]] = 0.0
        region[first[s]] = s
        keys[s], ids[s] = 0.0, first[s]
    _advance(indptr, indices, lengths, distance, region, keys, ids, first.shape[0])


@njit(cache=True, nogil=True)
def _insert(indptr, indices, lengths, vertices, sample, distance, region):
    keys, ids = np.empty(1024, dtype=np.float64), np.empty(1024, dtype=np.int32)
    for i in range(vertices.shape[0]):
        v = vertices[i]
        distance[v] = 0.0
        region[v] = sample + i
        keys[0], ids[0] = 0.0, v
        keys, ids = _advance(indptr, indices, lengths, distance, region, keys, ids, 1)


@njit(cache=True, nogil=True)
def _farther(d0, v0, d1, v1):
    return d0 > d1 or (d0 == d1 and v0 < v1)


@njit(cache=True, nogil=True)
def _sift(far, far_id, size, p, d, v):
    """Place (d, v) into a max-heap of `size` entries whose position p is free, downwards."""
    while True:
        child = 2 * p + 1
        if child >= size:
            break
        if child + 1 < size and _farther(far[child + 1], far_id[child + 1], far[child], far_id[child]):
            child += 1
        if not _farther(far[child], far_id[child], d, v):
            break
        far[p], far_id[p] = far[child], far_id[child]
        p = child
    far[p], far_id[p] = d, v


@njit(cache=True, nogil=True)
def _gather_farthest(distance, far, far_id):
    """Max-heap of the vertices in the farthest band; return its size and the band's lower end."""
    largest = distance.max()
    low = _BAND * largest if np.isfinite(largest) else np.inf
    size = 0
    for v in range(distance.shape[0]):
        if distance[v] >= low:
            far[size], far_id[size] = distance[v], v
            size += 1
    for p in range(size // 2 - 1, -1, -1):
        _sift(far, far_id, size, p, far[p], far_id[p])
    return size, low


@njit(cache=True, nogil=True)
def _insert_farthest(indptr, indices, lengths, count, sample, distance, region):
    n = distance.shape[0]
    samples = np.empty(count, dtype=np.int64)
    keys, ids = np.empty(1024, dtype=np.float64), np.empty(1024, dtype=np.int32)
    # Distances only shrink, so an entry of the max-heap is an upper bound: it is brought up to
    # date when it comes to the top. The heap holds the farthest band alone and is gathered anew
    # when that is used up, a dozen times in all.
    far, far_id = np.empty(n, dtype=np.float64), np.empty(n, dtype=np.int32)
    size, low = 0, 0.0
    for i in range(count):
        while True:
            if size == 0:
                size, low = _gather_farthest(distance, far, far_id)
            v = far_id[0]
            d = distance[v]
            if d == far[0]:
                break
            if d >= low:
                _sift(far, far_id, size, 0, d, v)
            else:
                size -= 1
                if size > 0:
                    _sift(far, far_id, size, 0, far[size], far_id[size])
        if d == 0.0:  # every vertex coincides with a sample
            return samples[:i]
        samples[i] = v
        distance[v] = 0.0
        region[v] = sample + i
        keys[0], ids[0] = 0.0, v
        keys, ids = _advance(indptr, indices, lengths, distance, region, keys, ids, 1)
    return samples
