"""The closed-ball test of Voronoi cells, and where samples must be added to pass it.

The dual of the cells is a mesh of the same topology when every cell, every
union of two adjacent ones and every union of three that meet in a triangle is
a disc. A union C is a disc when its dual cell complex has Euler characteristic

    chi(C) = #(inner vertices in C) - #(inner edges with an end in C) + #(triangles with a corner in C) = 1

(ReMatching, Maggioli et al. 2024). Edges and triangles are counted once for a
union however many of its cells they touch, so by inclusion and exclusion

    chi(ij)  = chi(i) + chi(j) - c(ij),   c(ij) = #triangles touching both - #inner edges between them
    chi(ijk) = chi(i) + chi(j) + chi(k) - c(ij) - c(jk) - c(ki) + #triangles touching all three

and one pass over edges and triangles serves every union. A triangle that touches both i and j has
two edges between them, or one if it touches a third cell too; an edge between them has two
triangles, or one on the boundary. Counted both ways, these incidences give

    2 c(ij) = #boundary edges between i and j + #triangles touching i, j and a third cell.

The count leaves the mesh's own boundary out, where each vertex, with its edge,
cancels. So a cell that crosses a strip, whose trace on the boundary is two
arcs, passes. On a mesh with boundary two more conditions are asked for: the
trace of a cell is one arc (boundary vertices minus boundary edges inside it
equals 1), and at most one boundary edge joins two cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.sampling.fronts import Fronts
from sshade.threads import in_ranges


class Unions(NamedTuple):
    """Cells, and the pairs and triples of them that meet, each with the counts that tell a disc.

    Attributes
    ----------
    chi, pair_chi, triple_chi : (k,), (p,), (t,) int64
        Euler characteristics.
    trace : (k,) int64
        Boundary vertices less boundary edges inside a cell; 1 for cells off the boundary.
    arcs : (p,) int64
        Boundary edges that join the cells of a pair.
    pairs, triples : (p, 2), (t, 3) int32
        Ids of cells, ascending.
    edges, edge_pair : (a, 2) int32 and (a,) int64
        Ends of the edges between cells, and the pair that each joins.
    faces, face_triple : (b,) int64
        Triangles that touch three cells, and their triple.
    """

    chi: np.ndarray
    pair_chi: np.ndarray
    triple_chi: np.ndarray
    trace: np.ndarray
    arcs: np.ndarray
    pairs: np.ndarray
    triples: np.ndarray
    edges: np.ndarray
    edge_pair: np.ndarray
    faces: np.ndarray
    face_triple: np.ndarray


def refinements(F: np.ndarray, fronts: Fronts) -> tuple[np.ndarray, np.ndarray]:
    """Find vertices to insert as samples because a union of cells near them is no disc.

    Parameters
    ----------
    F : (m, 3) int
        Faces of a manifold mesh.
    fronts : Fronts
        The cells to test.

    Returns
    -------
    vertices : (a,) int64
        Vertices to insert, farthest from their samples first, each once.
    failed : (b,) int32
        The first cell of each union that failed. Empty if and only if all are discs.
        With `failed` and no `vertices` the cells cannot be refined: they
        consist of samples alone.
    """
    u = count_unions(F, fronts)
    no_disc, no_arc = np.flatnonzero(u.chi != 1), np.flatnonzero(u.trace != 1)
    pairs, split = np.flatnonzero(u.pair_chi != 1), u.pairs[u.arcs > 1]
    triples = np.flatnonzero(u.triple_chi != 1)
    failed = np.concatenate([no_disc, no_arc, u.pairs[pairs, 0], split[:, 0], u.triples[triples, 0]])
    if len(failed) == 0:
        return np.zeros(0, dtype=np.int64), failed.astype(np.int32)

    cell, distance = fronts.cell, fronts.distance
    sample = np.zeros(len(cell), dtype=bool)
    sample[fronts.samples] = True
    concerned = np.zeros(len(fronts.samples), dtype=bool)
    for cells in (failed, u.pairs[pairs], split, u.triples[triples]):
        concerned[cells] = True
    free = np.flatnonzero(concerned[cell] & ~sample)
    outer = free[fronts.graph.on_boundary[free]]
    inside = _farthest(free, cell[free], distance, len(concerned))
    at_boundary = _farthest(outer, cell[outer], distance, len(concerned))

    def farthest_of(candidates: np.ndarray) -> np.ndarray:
        """Of each row the vertex farthest from its sample; -1 stands for none."""
        d = np.where(candidates >= 0, distance[candidates], -1.0)
        return np.take_along_axis(candidates, d.argmax(axis=1)[:, None], axis=1)[:, 0]

    # Of two cells the farthest end of the edges between them, if that is no sample already.
    between = np.isin(u.edge_pair, pairs)
    ends, pair = u.edges[between].ravel().astype(np.int64), np.repeat(u.edge_pair[between], 2)
    crossing = _farthest(ends[~sample[ends]], pair[~sample[ends]], distance, len(u.pairs))[pairs]
    # Of three cells the farthest corner of each triangle between them.
    between = np.isin(u.face_triple, triples)
    corners = F[u.faces[between]]
    corner = farthest_of(np.where(sample[corners], -1, corners))
    refined = np.isin(triples, u.face_triple[between][corner >= 0])
    chosen = [
        inside[no_disc],
        _either(at_boundary[no_arc], inside[no_arc]),
        _either(crossing, farthest_of(inside[u.pairs[pairs]])),
        _either(farthest_of(at_boundary[split]), farthest_of(inside[split])),
        corner,
        farthest_of(inside[u.triples[triples[~refined]]]),
    ]
    vertices = np.unique(np.concatenate(chosen))
    vertices = vertices[vertices >= 0]
    return vertices[np.argsort(-distance[vertices], kind="stable")], np.unique(failed).astype(np.int32)


def count_unions(F: np.ndarray, fronts: Fronts) -> Unions:
    """Count the vertices, edges and triangles of all cells, of pairs at an edge and triples at a triangle.

    Parameters
    ----------
    F : (m, 3) int
    fronts : Fronts
    """
    graph, cell, k = fronts.graph, fronts.cell, len(fronts.samples)
    rows = graph.indptr, graph.indices, graph.boundary
    counts, *lists = zip(
        *in_ranges(lambda first, end: _count_edges(first, end, *rows, cell, k), graph.n), strict=True
    )
    (chi, trace), (edges, inner, joined) = np.sum(counts, axis=0), map(np.concatenate, lists)
    trace[np.bincount(cell[graph.on_boundary], minlength=k) == 0] = 1
    corners, faces = faces_of_three(F, cell, k)
    chi += corners
    three = np.sort(cell[F[faces]], axis=1)
    pairs = np.concatenate([joined, three[:, :2], three[:, ::2], three[:, 1:]])
    first, pair = group_rows(pairs, k)
    pairs = pairs[first]
    at_edge, at_face = pair[: len(edges)], pair[len(edges) :]
    arcs = np.bincount(at_edge[~inner], minlength=len(pairs))
    c = (arcs + np.bincount(at_face, minlength=len(pairs))) // 2
    first, triple = group_rows(three, k)
    triples = three[first]
    triple_c = np.zeros(len(triples), dtype=np.int64)
    triple_c[triple] = c[at_face.reshape(3, -1)].sum(axis=0)
    pair_chi = chi[pairs].sum(axis=1) - c
    triple_chi = chi[triples].sum(axis=1) - triple_c + np.bincount(triple, minlength=len(triples))
    return Unions(chi, pair_chi, triple_chi, trace, arcs, pairs, triples, edges, at_edge, faces, triple)


def faces_of_three(F: np.ndarray, cell: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Count the triangles that touch each of k cells, and find those that touch three.

    Parameters
    ----------
    F : (m, 3) int
    cell : (n,) int32
    k : int

    Returns
    -------
    touching : (k,) int64
    faces : (b,) int64
        In ascending order.
    """
    touching, faces = zip(
        *in_ranges(lambda first, end: _count_triangles(first, end, F, cell, k), len(F)), strict=True
    )
    return np.sum(touching, axis=0), np.concatenate(faces)


def _either(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(first >= 0, first, second)


def _farthest(vertices: np.ndarray, owner: np.ndarray, distance: np.ndarray, count: int) -> np.ndarray:
    """(count,) of each owner's vertices the farthest from its sample, the smallest id of several; or -1."""
    nearest_first = np.lexsort((-vertices, distance[vertices]))
    found = np.full(count, -1, dtype=np.int64)
    found[owner[nearest_first]] = vertices[nearest_first]  # the last one that is written stays
    return found


@njit(cache=True, nogil=True)
def group_rows(rows, n):
    """Group equal rows of ids in linear time; no key is made of a row, which could overflow.

    Parameters
    ----------
    rows : (r, c) int
    n : int
        Above every id.

    Returns
    -------
    first : (g,) int64
        The first row of each group; the groups are in the lexicographic order of their rows.
    group : (r,) int64
        Group of each row.
    """
    # Counting sort by the last column first; each keeps the order of rows that are equal in it.
    order = np.arange(rows.shape[0])
    for c in range(rows.shape[1] - 1, -1, -1):
        place = np.zeros(n + 1, dtype=np.int64)
        for r in range(rows.shape[0]):
            place[rows[r, c] + 1] += 1
        for i in range(n):
            place[i + 1] += place[i]
        before, order = order, np.empty(rows.shape[0], dtype=np.int64)
        for r in before:
            order[place[rows[r, c]]] = r
            place[rows[r, c]] += 1
    group, first = np.empty(rows.shape[0], dtype=np.int64), np.empty(rows.shape[0], dtype=np.int64)
    count = 0
    for p in range(rows.shape[0]):
        new = p == 0
        for c in range(rows.shape[1]):
            new = new or rows[order[p], c] != rows[order[p - 1], c]
        if new:
            first[count] = order[p]
            count += 1
        group[order[p]] = count - 1
    return first[:count].copy(), group


@njit(cache=True, nogil=True)
def _count_edges(first, end, indptr, indices, boundary, cell, k):
    """Count vertices and edges of cells; list the edges between two: ends, inner or not, both cells.

    Of some vertices, and of their edges to those of larger ids.
    """
    counts = np.zeros((2, k), dtype=np.int64)
    chi, trace = counts
    most = indptr[end] - indptr[first]
    ends, joined = np.empty((most, 2), dtype=np.int32), np.empty((most, 2), dtype=np.int32)
    inner, count = np.empty(most, dtype=np.bool_), 0
    for u in range(first, end):
        i, on_boundary = cell[u], False
        for p in range(indptr[u], indptr[u + 1]):
            on_boundary = on_boundary or boundary[p]
            if indices[p] < u:
                continue
            j = cell[indices[p]]
            if i != j:
                ends[count, 0], ends[count, 1], inner[count] = u, indices[p], not boundary[p]
                joined[count, 0], joined[count, 1] = min(i, j), max(i, j)
                count += 1
            if not boundary[p]:
                chi[i] -= 1
                chi[j] -= i != j
            elif i == j:
                trace[i] -= 1
        if on_boundary:
            trace[i] += 1
        else:
            chi[i] += 1
    return counts, ends[:count].copy(), inner[:count].copy(), joined[:count].copy()


@njit(cache=True, nogil=True)
def _count_triangles(first, end, F, cell, k):
    """As of :func:`faces_of_three`, of some triangles."""
    touching, three, count = np.zeros(k, dtype=np.int64), np.empty(end - first, dtype=np.int64), 0
    for f in range(first, end):
        i, j, h = cell[F[f, 0]], cell[F[f, 1]], cell[F[f, 2]]
        touching[i] += 1
        touching[j] += j != i
        touching[h] += h != i and h != j
        if i != j and j != h and h != i:
            three[count] = f
            count += 1
    return touching, three[:count].copy()
