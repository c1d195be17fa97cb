"""Kernels that advance fronts from samples over the edges of a mesh (delta-stepping)."""

from __future__ import annotations

from heapq import heapify, heappop, heapreplace
from typing import NamedTuple

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.mesh.adjacency import VertexGraph

#: Distances, as fractions of the largest, down to which vertices become candidates for the next farthest
#: vertex, and down to which candidates enter the heap. Most candidates are covered before their turn and
#: never need the heap.
_GATHERED, _QUEUED = 0.8, 0.97

#: Queue of a vertex.
NOWHERE, NEAR, FAR = 0, 1, 2
#: In place of a slab's number: fronts may go everywhere.
EVERYWHERE = -1


class State(NamedTuple):
    """The graph, the current Voronoi cells, and the queues of the fronts that change the cells.

    Vertex ids are unsigned. Numba then omits its test for negative indices, and fronts take two thirds of
    the time.

    Attributes
    ----------
    indptr, indices, lengths : (n + 1,) uint32, (2e,) uint32, (2e,) float64
        See :class:`sshade.mesh.adjacency.VertexGraph`.
    width : float
        Width of a band, in the unit of length. Every positive width gives the same result.
    distance, cell : (n,) float64 and (n,) int32
        Distance of each vertex to its sample, and the number of that sample. A front takes a vertex over
        if it is nearer, or equally near and of a smaller number.
    queued : (n,) uint8
        Queue that holds each vertex: :data:`NEAR`, :data:`FAR` or :data:`NOWHERE`.
    near : (r,) uint32
        Ring buffer of vertices in the current band. r is a power of two above the number of vertices that
        fronts may reach.
    far : (r,) uint32
        Vertices in later bands.
    slab : (n,) uint8
        Slab of each vertex, see :mod:`sshade.proxy.coarse`; empty if fronts may go everywhere.
    confined_to : int
        Slab that fronts stay in, or :data:`EVERYWHERE`.
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
    confined_to: int

    @classmethod
    def of(cls, graph: VertexGraph, *, width: float, distance: np.ndarray, cell: np.ndarray) -> State:
        """Return fronts that may go everywhere, with initial distances (n,) and cells (n,)."""
        ring = 1 << graph.n.bit_length()
        rows = (graph.indptr, graph.indices)
        indptr, indices = (ids.astype(np.int32, copy=False).view(np.uint32) for ids in rows)
        return cls(
            indptr=indptr,
            indices=indices,
            lengths=graph.lengths,
            width=width,
            distance=distance,
            cell=cell,
            queued=np.zeros(graph.n, dtype=np.uint8),
            near=np.empty(ring, dtype=np.uint32),
            far=np.empty(ring, dtype=np.uint32),
            slab=np.empty(0, dtype=np.uint8),
            confined_to=EVERYWHERE,
        )

    def within(self, slab: np.ndarray, confined_to: int, vertices: int) -> State:
        """Return this state with new queues, for fronts confined to a slab of `vertices` vertices."""
        near, far = np.empty((2, 1 << int(vertices).bit_length()), dtype=np.uint32)
        return self._replace(slab=slab, confined_to=confined_to, near=near, far=far)


@subroutine
def _advance(state, size):
    """Advance fronts from the first `size` entries of `near` to every vertex that is nearer to them.

    Delta-stepping corrects distances in bands of equal width, in any order within a band. A vertex may be
    visited again; a heap would avoid this at several times the cost. The result does not depend on the
    order: each distance is the minimum of sums taken from the samples outwards, and ties go to the smaller
    sample.

    U. Meyer, P. Sanders, "Delta-stepping: a parallelizable shortest path algorithm", 2003.
    """
    indptr, indices, lengths = state.indptr, state.indices, state.lengths
    slab, confined_to = state.slab, state.confined_to
    distance, cell, queued, near, far = state.distance, state.cell, state.queued, state.near, state.far
    inside = confined_to != EVERYWHERE
    # Signed numbers would turn these into floats.
    one, mask = np.uint64(1), np.uint64(near.shape[0] - 1)
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
                    # Tested last, because most vertices are no nearer. Vertices of other slabs belong to
                    # other threads.
                    if inside and slab[w] != confined_to:
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
        # The next band begins at the nearest waiting vertex.
        nearest = np.inf
        for q in range(waiting):
            if queued[far[q]] == FAR and distance[far[q]] < nearest:
                nearest = distance[far[q]]
        limit = nearest + state.width
        kept = np.uint64(0)
        for q in range(waiting):
            w = far[q]
            if queued[w] != FAR:
                continue  # it came nearer and was treated in an earlier band
            if distance[w] < limit:
                queued[w] = NEAR
                near[tail] = w
                tail = (tail + one) & mask
            else:
                far[kept] = w
                kept += one
        waiting = kept


@kernel
def start(state, first):
    """Insert samples (h,), numbered from 0, and advance their fronts together."""
    for s in range(first.shape[0]):
        _place(state, first[s], s, s)
    _advance(state, first.shape[0])


@kernel
def insert(state, vertices, sample):
    """Insert vertices as samples with the numbers `sample` (k,), and advance their fronts one by one."""
    for i in range(vertices.shape[0]):
        _place(state, vertices[i], sample[i], 0)
        _advance(state, 1)


@kernel
def cover(state, vertices, first):
    """Insert the vertices `first`, then each of `vertices` that no front has reached before its turn.

    Returns the inserted samples (k,). Their cells are numbered from 0.
    """
    samples = np.empty(len(vertices), dtype=np.int64)
    count = 0
    for v in np.concatenate((first, vertices)):
        if count < len(first) or state.cell[v] < 0:
            samples[count] = v
            _place(state, v, count, 0)
            _advance(state, 1)
            count += 1
    return samples[:count].copy()


@kernel
def from_outside(state, border):
    """Find the vertices of `border` that are nearer to a sample through a neighbour.

    Returns the vertices found, their new distances, and their new cells.
    """
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


@kernel
def resume(state, vertices, near, sample):
    """Advance fronts from vertices reached from outside, with distances `near` and cells `sample`."""
    for i in range(len(vertices)):
        state.distance[vertices[i]], state.cell[vertices[i]] = near[i], sample[i]
        state.near[i], state.queued[vertices[i]] = vertices[i], NEAR
    _advance(state, len(vertices))


@subroutine
def _place(state, vertex, sample, position):
    """Make a vertex a sample and put it into the queue, at `position`."""
    state.distance[vertex] = 0.0
    state.cell[vertex] = sample
    state.near[position] = vertex


@kernel
def insert_farthest(state, count, sample, among):
    """Insert `count` samples, each the vertex of `among` farthest from all samples before it.

    The samples get numbers from `sample` on; they are returned in this order.
    """
    distance = state.distance
    samples = np.empty(count, dtype=np.int64)
    # Distances only shrink, so an entry (-distance, vertex) of the heap is an upper bound, which is updated
    # when it comes to the top. The heap holds only the farthest candidates. When it is empty it is filled
    # again from the candidates; candidates come from all vertices.
    gathered, lowest = among[:0], np.inf
    heap, low = [(0.0, among[0]) for _ in range(0)], np.inf
    for i in range(count):
        while True:
            if len(heap) == 0:
                gathered = gathered[distance[gathered] >= lowest]
                if len(gathered) == 0:
                    lowest = _GATHERED * distance[among].max()
                    gathered = among[distance[among] >= lowest]
                low = max(lowest, _QUEUED * distance[gathered].max())
                heap = [(-distance[v], v) for v in gathered[distance[gathered] >= low]]
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
