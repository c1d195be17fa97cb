"""The closed-ball test: find where the dual of Voronoi cells would have another topology than the mesh.

The dual of the cells is a mesh of the same topology as M if every cell, every union of two cells that share
an edge of M, and every union of three cells that meet in a triangle is a topological disc. For unions that
fail, :func:`refinements` returns vertices to add as samples. A union C is a disc if its Euler characteristic
is one:

    chi(C) = #(inner vertices in C) - #(inner edges with an end in C) + #(triangles with a corner in C) = 1 .

This is the condition of ReMatching (F. Maggioli, D. Baieri, S. Melzi, E. Rodola, "ReMatching: low-resolution
representations for scalable shape correspondence", 2024).

A union counts an edge or triangle once, however many of its cells touch it. Inclusion and exclusion give, for
cells i, j and k,

    chi(ij)  = chi(i) + chi(j) - c(ij),   c(ij) = #triangles touching both - #inner edges between them
    chi(ijk) = chi(i) + chi(j) + chi(k) - c(ij) - c(jk) - c(ki) + #triangles touching all three .

One pass over edges and triangles therefore serves all unions. To find c(ij), count incidences of edges and
triangles: a triangle that touches i and j has two edges between them, or one if it touches a third cell; an
edge between them has two triangles, or one on the boundary. Hence

    2 c(ij) = #boundary edges between i and j + #triangles touching i, j and a third cell .

The sum leaves out the boundary of M, where each vertex cancels with an edge. It would accept a cell that
crosses a strip and has two arcs on the boundary. On a mesh with boundary, two conditions are added: the trace
of a cell on the boundary is one arc (boundary vertices minus boundary edges inside the cell equals 1), and at
most one boundary edge joins two cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.incidence import flagged, group_rows
from sshade.proxy.fronts import Fronts


class Unions(NamedTuple):
    """Cells, pairs of cells that share an edge, triples that meet in a triangle, and their counts.

    Attributes
    ----------
    chi, pair_chi, triple_chi : (k,), (p,), (t,) int64
        Euler characteristics of cells, pairs and triples.
    trace : (k,) int64
        Boundary vertices minus boundary edges inside each cell; 1 for cells off the boundary.
    arcs : (p,) int64
        Boundary edges that join the two cells of a pair.
    pairs, triples : (p, 2), (t, 3) int32
        Cells of each pair and triple, in ascending order.
    edges, edge_pair : (a, 2) int32 and (a,) int64
        Ends of the edges between two cells, and the pair of each edge.
    faces, face_triple : (b,) int64
        Triangles that touch three cells, and the triple of each triangle.
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
    """Find vertices to insert as samples near unions of cells that are no discs.

    Parameters
    ----------
    F : (m, 3) int
        Faces of a manifold mesh.
    fronts : Fronts
        The cells to test.

    Returns
    -------
    vertices : (a,) int64
        Distinct vertices to insert, farthest from their samples first.
    failed : (b,) int32
        First cell of each union that failed; empty if and only if all unions are discs. If `failed` is not
        empty but `vertices` is, the failed cells consist of samples alone and cannot be refined.
    """
    u = count_unions(F, fronts)
    no_disc, no_arc = np.flatnonzero(u.chi != 1), np.flatnonzero(u.trace != 1)
    pairs, split = np.flatnonzero(u.pair_chi != 1), u.pairs[u.arcs > 1]
    triples = np.flatnonzero(u.triple_chi != 1)
    failed = np.concatenate([no_disc, no_arc, u.pairs[pairs, 0], split[:, 0], u.triples[triples, 0]])
    if len(failed) == 0:
        return np.zeros(0, dtype=np.int64), failed.astype(np.int32)

    cell, distance, k = fronts.cell, fronts.distance, len(fronts.samples)
    is_sample = flagged(fronts.samples, len(cell))
    concerned = np.zeros(k, dtype=bool)
    for cells in (failed, u.pairs[pairs], split, u.triples[triples]):
        concerned[cells] = True
    candidates = np.flatnonzero(concerned[cell] & ~is_sample)
    outer = candidates[fronts.graph.on_boundary[candidates]]
    inside = _farthest(candidates, cell[candidates], distance, k)
    at_boundary = _farthest(outer, cell[outer], distance, k)

    def farthest_in_row(vertices: np.ndarray) -> np.ndarray:
        """Return the vertex of each row that is farthest from its sample; -1 stands for no vertex."""
        d = np.where(vertices >= 0, distance[vertices], -1.0)
        return np.take_along_axis(vertices, d.argmax(axis=1)[:, None], axis=1)[:, 0]

    # For a pair, the farthest end of the edges between its cells, unless all ends are samples.
    between = np.isin(u.edge_pair, pairs)
    ends, pair = u.edges[between].ravel().astype(np.int64), np.repeat(u.edge_pair[between], 2)
    crossing = _farthest(ends[~is_sample[ends]], pair[~is_sample[ends]], distance, len(u.pairs))[pairs]
    # For a triple, the farthest corner of each triangle between its cells.
    between = np.isin(u.face_triple, triples)
    corners = F[u.faces[between]]
    corner = farthest_in_row(np.where(is_sample[corners], -1, corners))
    refined = np.isin(triples, u.face_triple[between][corner >= 0])
    chosen = [
        inside[no_disc],
        _first_found(at_boundary[no_arc], inside[no_arc]),
        _first_found(crossing, farthest_in_row(inside[u.pairs[pairs]])),
        _first_found(farthest_in_row(at_boundary[split]), farthest_in_row(inside[split])),
        corner,
        farthest_in_row(inside[u.triples[triples[~refined]]]),
    ]
    vertices = np.unique(np.concatenate(chosen))
    vertices = vertices[vertices >= 0]
    return vertices[np.argsort(-distance[vertices], kind="stable")], np.unique(failed).astype(np.int32)


def count_unions(F: np.ndarray, fronts: Fronts) -> Unions:
    """Compute the Euler characteristics of all cells, pairs that share an edge, and triples of a triangle.

    Parameters
    ----------
    F : (m, 3) int
        Faces of a manifold mesh.
    fronts : Fronts
        The cells.
    """
    graph, cell, k = fronts.graph, fronts.cell, len(fronts.samples)
    rows = graph.indptr, graph.indices, graph.boundary
    counts, *lists = zip(*in_ranges(_count_edges, graph.n, *rows, cell, k), strict=True)
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
    """Count the triangles that touch each of k cells, and find the triangles that touch three.

    Parameters
    ----------
    F : (m, 3) int
    cell : (n,) int32
        Cell of each vertex.
    k : int

    Returns
    -------
    touching : (k,) int64
    faces : (b,) int64
        In ascending order.
    """
    touching, faces = zip(*in_ranges(_count_triangles, len(F), F, cell, k), strict=True)
    return np.sum(touching, axis=0), np.concatenate(faces)


def _first_found(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(first >= 0, first, second)


def _farthest(vertices: np.ndarray, owner: np.ndarray, distance: np.ndarray, count: int) -> np.ndarray:
    """Return (count,) the vertex of each owner that is farthest from its sample; -1 without vertices.

    Among equally far vertices the smallest id wins.
    """
    nearest_first = np.lexsort((-vertices, distance[vertices]))
    found = np.full(count, -1, dtype=np.int64)
    found[owner[nearest_first]] = vertices[nearest_first]  # the last assignment stays
    return found


@kernel
def _count_edges(first, end, indptr, indices, boundary, cell, k):
    """Count vertices and edges of cells, for a range of vertices and their edges to larger vertices.

    Returns the sums `chi` and `trace` of :class:`Unions` without triangles, (2, k); and for the edges
    between two cells their ends, whether they are inner edges, and the two cells.
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


@kernel
def _count_triangles(first, end, F, cell, k):
    """Do the work of :func:`faces_of_three` for a range of triangles."""
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
