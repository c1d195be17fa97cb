"""How fronts advance over the edges of a mesh: delta-stepping, in kernels over plain arrays."""

from __future__ import annotations

from heapq import heapify, heappop, heapreplace
from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.mesh.adjacency import VertexGraph

#: Candidates for the next farthest vertex are gathered down to the first fraction of the largest distance
#: and, of these, queued down to the second: most are covered before their turn, and need no queue.
_GATHERED, _QUEUED = 0.8, 0.97

NOWHERE, NEAR, FAR = 0, 1, 2
#: Instead of the number of a slab: fronts go everywhere.
EVERYWHERE = -1


class State(NamedTuple):
    """The graph, the cells so far, and the queues of the fronts that change them.

    Vertices are unsigned here: without the test for negative indices, which numba counts from the end,
    fronts take two thirds of the time.

    Attributes
    ----------
    indptr, indices, lengths : (n + 1,) uint32, (2e,) uint32, (2e,) float64
        See :class:`sshade.mesh.adjacency.VertexGraph`.
    width : float
        Width of a band, in the unit of length; any positive one gives the same result.
    distance, cell : (n,) float64 and (n,) int32
        Fronts go where they are nearer than that, or as near and of a smaller cell.
    queued : (n,) uint8
        Which of the two queues a vertex is in, if any.
    near : (r,) uint32
        A ring of the vertices in the band at work; r is a power of two above the number of vertices
        that fronts may reach.
    far : (r,) uint32
        Those for later bands.
    slab : (n,) uint8
        Of each vertex.
    own : int
        The slab that fronts stay in, or :data:`EVERYWHERE`.
    """

    indptr: np.ndarray
    indices: np.ndarray
    lengths: np.ndarray
    width: float
    distance: np.ndarray
    cell: np.ndarray
    queued: np.ndarray
    near: np.ndarray
    far: np.ndarray
    slab: np.ndarray
    own: int

    @classmethod
    def of(cls, graph: VertexGraph, *, width: float, distance: np.ndarray, cell: np.ndarray) -> State:
        """Fronts that may go everywhere, given what they begin with."""
        ring = 1 << graph.n.bit_length()
        return cls(
            indptr=_unsigned(graph.indptr),
            indices=_unsigned(graph.indices),
            lengths=graph.lengths,
            width=width,
            distance=distance,
            cell=cell,
            queued=np.zeros(graph.n, dtype=np.uint8),
            near=np.empty(ring, dtype=np.uint32),
            far=np.empty(ring, dtype=np.uint32),
            slab=np.empty(0, dtype=np.uint8),
            own=EVERYWHERE,
        )

    def within(self, slab: np.ndarray, own: int, vertices: int) -> State:
        """The same state for fronts that stay in a slab of so many vertices, with queues of their own."""
        near, far = np.empty((2, 1 << int(vertices).bit_length()), dtype=np.uint32)
        return self._replace(slab=slab, own=own, near=near, far=far)


def _unsigned(ids: np.ndarray) -> np.ndarray:
    return ids.astype(np.int32, copy=False).view(np.uint32)


@njit(cache=True, nogil=True)
def _advance(state, size):
    """Relax the distances of all that is nearer to the first `size` entries of `near` than to its sample.

    Delta-stepping: labels are corrected in bands of equal width, in any order within a band; a
    vertex may be visited again, but no heap is kept, which would cost several times as much. The
    labels end the same to the last bit: each is the minimum of sums taken from the samples
    outwards, and ties go to the smaller sample.

    U. Meyer, P. Sanders, "Delta-stepping: a parallelizable shortest path algorithm", 2003.
    """
    indptr, indices, lengths, slab, own = state.indptr, state.indices, state.lengths, state.slab, state.own
    distance, cell, queued, near, far = state.distance, state.cell, state.queued, state.near, state.far
    inside = own != EVERYWHERE
    one, mask = np.uint64(1), np.uint64(near.shape[0] - 1)  # with a signed number they would be floats
    head, tail, waiting, limit = np.uint64(0), np.uint64(size), np.uint64(0), state.width
    while head != tail:
        while head != tail:
            u = near[head]
            head = (head + one) & mask
            queued[u] = NOWHERE
            d, s = distance[u], cell[u]
            for p in range(indptr[u], indptr[u + one]):
                w = indices[p]
                nd = d + lengths[p]
                if nd < distance[w] or (nd == distance[w] and s < cell[w]):
                    # Only now, for most are no nearer. Another thread may be at a foreign vertex: it is left.
                    if inside and slab[w] != own:
                        continue
                    distance[w] = nd
                    cell[w] = s
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
def start(state, first):
    """Let the fronts of some samples, numbered from 0, advance together."""
    for s in range(first.shape[0]):
        _place(state, first[s], s, s)
    _advance(state, first.shape[0])


@njit(cache=True, nogil=True)
def insert(state, vertices, sample):
    """Let the fronts of some samples advance one after the other, of numbers (k,) `sample`."""
    for i in range(vertices.shape[0]):
        _place(state, vertices[i], sample[i], 0)
        _advance(state, 1)


@njit(cache=True, nogil=True)
def cover(state, vertices, first):
    """Insert the `first`, and every one of some vertices that no front has reached before its turn.

    Returns the samples, numbered from 0 within this call.
    """
    samples = np.empty(len(vertices), dtype=np.int64)
    count = 0
    for part in range(2):
        for v in first if part == 0 else vertices:
            if part == 0 or state.cell[v] < 0:
                samples[count] = v
                _place(state, v, count, 0)
                _advance(state, 1)
                count += 1
    return samples[:count].copy()


@njit(cache=True, nogil=True)
def from_outside(state, border):
    """Those of some vertices that are nearer to a sample through a neighbour; how near, and to which."""
    distance, cell = state.distance, state.cell
    found, near, sample = np.empty_like(border), np.empty(len(border)), np.empty(len(border), dtype=np.int32)
    count = 0
    for w in border:
        d, s = distance[w], cell[w]
        for p in range(state.indptr[w], state.indptr[w + 1]):
            u = state.indices[p]
            nd = distance[u] + state.lengths[p]
            if cell[u] >= 0 and (nd < d or (nd == d and cell[u] < s)):
                d, s = nd, cell[u]
        if d < distance[w] or s != cell[w]:
            found[count], near[count], sample[count] = w, d, s
            count += 1
    return found[:count].copy(), near[:count].copy(), sample[:count].copy()


@njit(cache=True, nogil=True)
def resume(state, vertices, near, sample):
    """Let fronts go on from some vertices, which they have reached from outside."""
    for i in range(len(vertices)):
        state.distance[vertices[i]], state.cell[vertices[i]] = near[i], sample[i]
        state.near[i], state.queued[vertices[i]] = vertices[i], NEAR
    _advance(state, len(vertices))


@njit(cache=True, nogil=True)
def _place(state, vertex, sample, position):
    """Make a vertex a sample, from which the next front begins."""
    state.distance[vertex] = 0.0
    state.cell[vertex] = sample
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
def insert_farthest(state, count, sample, among):
    """Insert samples, numbered from `sample` on, each of some vertices the farthest from all before it."""
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
