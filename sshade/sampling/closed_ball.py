"""The closed-ball test of Voronoi regions, and where samples must be added to pass it.

The dual of the regions is a mesh of the same topology when every region, every
union of two adjacent ones and every union of three that meet in a triangle is
a disc. A union C is a disc when its dual cell complex has Euler characteristic

    chi(C) = #(inner vertices in C) - #(inner edges with an end in C) + #(triangles with a corner in C) = 1

(ReMatching, Maggioli et al. 2024). Edges and triangles are counted once for a
union however many of its regions they touch, so by inclusion and exclusion

    chi(ij)  = chi(i) + chi(j) - c(ij),   c(ij) = #triangles touching both - #inner edges between them
    chi(ijk) = chi(i) + chi(j) + chi(k) - c(ij) - c(jk) - c(ki) + #triangles touching all three

and one pass over edges and triangles serves every union.

The count leaves the mesh's own boundary out, where each vertex, with its edge,
cancels. So a region that crosses a strip, whose trace on the boundary is two
arcs, passes. On a mesh with boundary two more conditions are asked for: the
trace of a region is one arc (boundary vertices minus boundary edges inside it
equals 1), and at most one boundary edge joins two regions.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.sampling.fronts import Fronts


def refinements(F: np.ndarray, fronts: Fronts) -> tuple[np.ndarray, np.ndarray]:
    """Vertices to insert as samples because a union near them is no disc.

    Parameters
    ----------
    F : (m, 3) int
        Faces of a manifold mesh.
    fronts : Fronts
        The regions to test.

    Returns
    -------
    vertices : (a,) int64
        Vertices to insert, farthest from their samples first, each once.
    failed : (b,) int32
        A region of each union that failed. Empty if and only if all are discs.
        With `failed` and no `vertices` the regions cannot be refined: they
        consist of samples alone.
    """
    graph, samples = fronts.graph, fronts.samples
    is_sample = np.zeros(graph.n, dtype=np.bool_)
    is_sample[samples] = True
    marked, failed = _test(
        F,
        graph.indptr,
        graph.indices,
        graph.boundary,
        fronts.region,
        fronts.distance,
        is_sample,
        len(samples),
    )
    vertices = np.flatnonzero(marked)
    order = np.lexsort((vertices, -fronts.distance[vertices]))
    return vertices[order], np.flatnonzero(failed).astype(np.int32)


@njit(cache=True, nogil=True)
def _slot(table, key):
    """Position of `key` in an open-addressing table, or of the free place where it belongs."""
    mask = table.shape[0] - 1
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    p = np.int64(h >> np.uint64(32)) & mask
    while table[p] != -1 and table[p] != key:
        p = (p + 1) & mask
    return p


@njit(cache=True, nogil=True)
def _pair_key(i, j, k):
    return min(i, j) * k + max(i, j)


@njit(cache=True, nogil=True)
def _pair_table(indptr, indices, region, k):
    """Hash table of the pairs of regions that an edge joins."""
    table = np.full(1024, -1, dtype=np.int64)
    used = 0
    for u in range(indptr.shape[0] - 1):
        i = np.int64(region[u])
        for p in range(indptr[u], indptr[u + 1]):
            j = np.int64(region[indices[p]])
            if j <= i:
                continue
            slot = _slot(table, i * k + j)
            if table[slot] == -1:
                table[slot] = i * k + j
                used += 1
                if 2 * used > table.shape[0]:
                    larger = np.full(2 * table.shape[0], -1, dtype=np.int64)
                    for q in range(table.shape[0]):
                        if table[q] != -1:
                            larger[_slot(larger, table[q])] = table[q]
                    table = larger
    return table


@njit(cache=True, nogil=True)
def _count_edges(indptr, indices, boundary, region, table, chi, trace, c, crossings):
    """Add vertices and edges to the Euler counts; see the module's formulas."""
    k = chi.shape[0]
    for u in range(indptr.shape[0] - 1):
        i = np.int64(region[u])
        on_boundary = False
        for p in range(indptr[u], indptr[u + 1]):
            w = indices[p]
            on_boundary = on_boundary or boundary[p]
            if w < u:
                continue
            j = np.int64(region[w])
            if i == j:
                if boundary[p]:
                    trace[i] -= 1
                else:
                    chi[i] -= 1
                continue
            slot = _slot(table, _pair_key(i, j, k))
            if boundary[p]:
                crossings[slot] += 1
            else:
                chi[i] -= 1
                chi[j] -= 1
                c[slot] -= 1
        if on_boundary:
            trace[i] += 1
        else:
            chi[i] += 1


@njit(cache=True, nogil=True)
def _count_triangles(F, region, table, chi, c):
    """Add triangles to the Euler counts; return the faces that touch three regions."""
    k = chi.shape[0]
    three = np.empty(F.shape[0], dtype=np.int64)
    count = 0
    for f in range(F.shape[0]):
        i, j, h = np.int64(region[F[f, 0]]), np.int64(region[F[f, 1]]), np.int64(region[F[f, 2]])
        chi[i] += 1
        if j != i:
            chi[j] += 1
            c[_slot(table, _pair_key(i, j, k))] += 1
        if h != i and h != j:
            chi[h] += 1
            c[_slot(table, _pair_key(i, h, k))] += 1
            if i != j:
                c[_slot(table, _pair_key(j, h, k))] += 1
                three[count] = f
                count += 1
    return three[:count]


@njit(cache=True, nogil=True)
def _farthest_of_regions(region, distance, is_sample, on_boundary, k):
    """For each region its farthest vertex that is no sample, and the farthest such on the boundary."""
    inner = np.full(k, -1, dtype=np.int64)
    border = np.full(k, -1, dtype=np.int64)
    for v in range(region.shape[0]):
        if is_sample[v]:
            continue
        i = region[v]
        if inner[i] == -1 or distance[v] > distance[inner[i]]:
            inner[i] = v
        if on_boundary[v] and (border[i] == -1 or distance[v] > distance[border[i]]):
            border[i] = v
    return inner, border


@njit(cache=True, nogil=True)
def _farther_of(a, b, distance):
    """The farther of two vertices, either of which may be missing (-1)."""
    if a == -1 or (b != -1 and distance[b] > distance[a]):
        return b
    return a


@njit(cache=True, nogil=True)
def _mark(v, marked):
    if v != -1:
        marked[v] = True


@njit(cache=True, nogil=True)
def _crossing_candidates(indptr, indices, region, distance, is_sample, table, wanted):
    """For each wanted pair of regions the farthest end, no sample, of the edges between them."""
    k = region.max() + 1
    concerned = np.zeros(k, dtype=np.bool_)
    for slot in range(table.shape[0]):
        if wanted[slot]:
            concerned[table[slot] // k] = concerned[table[slot] % k] = True
    best = np.full(table.shape[0], -1, dtype=np.int64)
    for u in range(indptr.shape[0] - 1):
        i = np.int64(region[u])
        if not concerned[i] or is_sample[u]:
            continue
        for p in range(indptr[u], indptr[u + 1]):
            j = np.int64(region[indices[p]])
            if j != i and concerned[j]:
                slot = _slot(table, _pair_key(i, j, k))
                best[slot] = _farther_of(best[slot], u, distance)
    return best


@njit(cache=True, nogil=True)
def _test(F, indptr, indices, boundary, region, distance, is_sample, k):
    n = indptr.shape[0] - 1
    on_boundary = np.zeros(n, dtype=np.bool_)
    for u in range(n):
        for p in range(indptr[u], indptr[u + 1]):
            if boundary[p]:
                on_boundary[u] = True
    table = _pair_table(indptr, indices, region, k)
    chi, trace = np.zeros(k, dtype=np.int64), np.zeros(k, dtype=np.int64)
    c, crossings = np.zeros(table.shape[0], dtype=np.int64), np.zeros(table.shape[0], dtype=np.int64)
    _count_edges(indptr, indices, boundary, region, table, chi, trace, c, crossings)
    three = _count_triangles(F, region, table, chi, c)
    touches = np.zeros(k, dtype=np.bool_)
    for u in range(n):
        if on_boundary[u]:
            touches[region[u]] = True

    marked = np.zeros(n, dtype=np.bool_)
    failed = np.zeros(k, dtype=np.bool_)
    inner, border = _farthest_of_regions(region, distance, is_sample, on_boundary, k)
    for i in range(k):
        if chi[i] != 1:
            failed[i] = True
            _mark(inner[i], marked)
        if touches[i] and trace[i] != 1:
            failed[i] = True
            _mark(border[i] if border[i] != -1 else inner[i], marked)
    _test_pairs(
        indptr, indices, region, distance, is_sample, table, chi, c, crossings, inner, border, marked, failed
    )
    _test_triples(F, three, region, distance, is_sample, table, chi, c, inner, marked, failed)
    return marked, failed


@njit(cache=True, nogil=True)
def _test_pairs(
    indptr, indices, region, distance, is_sample, table, chi, c, crossings, inner, border, marked, failed
):
    k = chi.shape[0]
    no_disc = np.zeros(table.shape[0], dtype=np.bool_)
    for slot in range(table.shape[0]):
        if table[slot] != -1:
            no_disc[slot] = chi[table[slot] // k] + chi[table[slot] % k] - c[slot] != 1
    if no_disc.any():
        best = _crossing_candidates(indptr, indices, region, distance, is_sample, table, no_disc)
        for slot in np.flatnonzero(no_disc):
            i, j = table[slot] // k, table[slot] % k
            failed[i] = True
            if best[slot] != -1:
                marked[best[slot]] = True
            else:  # all crossing edges join samples: refine inside the union
                _mark(_farther_of(inner[i], inner[j], distance), marked)
    for slot in np.flatnonzero(crossings > 1):
        i, j = table[slot] // k, table[slot] % k
        failed[i] = True
        v = _farther_of(border[i], border[j], distance)
        _mark(v if v != -1 else _farther_of(inner[i], inner[j], distance), marked)


@njit(cache=True, nogil=True)
def _triple_table(F, three, region, k):
    """Hash table of the triples of regions that triangles touch, with their numbers of triangles.

    Samples number fewer than 2^21, so three of them fit one integer.
    """
    size = 1024
    while size < 2 * three.shape[0]:
        size *= 2
    table, count = np.full(size, -1, dtype=np.int64), np.zeros(size, dtype=np.int64)
    slots = np.empty(three.shape[0], dtype=np.int64)
    for r in range(three.shape[0]):
        f = three[r]
        i, j, h = np.int64(region[F[f, 0]]), np.int64(region[F[f, 1]]), np.int64(region[F[f, 2]])
        low, high = min(i, j, h), max(i, j, h)
        key = (low * k + (i + j + h - low - high)) * k + high
        slots[r] = _slot(table, key)
        table[slots[r]] = key
        count[slots[r]] += 1
    return table, count, slots


@njit(cache=True, nogil=True)
def _test_triples(F, three, region, distance, is_sample, table, chi, c, inner, marked, failed):
    k = chi.shape[0]
    triples, count, slots = _triple_table(F, three, region, k)
    no_disc = np.zeros(triples.shape[0], dtype=np.bool_)
    for slot in range(triples.shape[0]):
        if triples[slot] != -1:
            i, j, h = triples[slot] // k // k, triples[slot] // k % k, triples[slot] % k
            pairs = c[_slot(table, i * k + j)] + c[_slot(table, i * k + h)] + c[_slot(table, j * k + h)]
            no_disc[slot] = chi[i] + chi[j] + chi[h] - pairs + count[slot] != 1
    if not no_disc.any():
        return
    refined = np.zeros(triples.shape[0], dtype=np.bool_)
    for r in range(three.shape[0]):
        if no_disc[slots[r]]:
            v = -1
            for a in range(3):
                w = F[three[r], a]
                if not is_sample[w]:
                    v = _farther_of(v, w, distance)
            if v != -1:
                marked[v] = refined[slots[r]] = True
    for slot in np.flatnonzero(no_disc):
        i, j, h = triples[slot] // k // k, triples[slot] // k % k, triples[slot] % k
        failed[i] = True
        if not refined[slot]:
            _mark(_farther_of(_farther_of(inner[i], inner[j], distance), inner[h], distance), marked)
