"""What the faces of a mesh say about its connectivity, in one pass of linear time and memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Connectivity(NamedTuple):
    """Facts about the faces of a mesh.

    Attributes
    ----------
    edges, boundary_edges : int
        Undirected edges, and those with a single face.
    component : (n,) int32
        Connected component of each vertex, numbered by first vertex.
    components, boundary_loops : int
        A loop is a connected set of boundary edges.
    crowded_edge : (3,) int64
        An edge of more than two faces and their number; -1 where there is none.
    split_vertex : int
        A vertex whose faces form more than one fan; -1 if none.
    oriented : bool
        No two faces run through an edge in the same direction.
    """

    edges: int
    boundary_edges: int
    component: np.ndarray
    components: int
    boundary_loops: int
    crowded_edge: np.ndarray
    split_vertex: int
    oriented: bool


def connectivity(F: np.ndarray, n: int) -> Connectivity:
    """Analyse faces.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; every vertex in some face.
    n : int
        Number of vertices.
    """
    return Connectivity(*_connectivity(F, n))


@njit(cache=True, nogil=True)
def rows_of_edges(F, n):
    """Number the edges of faces (m, 3) by their smaller id, then by the larger; (m, 3) int64.

    Of a face the edges from corner 0 to 1, 1 to 2, and 2 to 0.
    """
    m = F.shape[0]
    start = np.zeros(n + 1, dtype=np.int32)
    for f in range(m):
        for c in range(3):
            start[min(F[f, c], F[f, c - 2]) + 1] += 1  # c - 2 is the next corner: 0 is -3
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    # Of each side of a face the larger id, and which side it is, in the row of the smaller id.
    sides = np.empty((3 * m, 2), dtype=np.int32)
    for f in range(m):
        for c in range(3):
            i, j = F[f, c], F[f, c - 2]
            low = min(i, j)
            p = fill[low]
            fill[low] += 1
            sides[p, 0], sides[p, 1] = max(i, j), 3 * f + c
    rows = np.empty(3 * m, dtype=np.int64)
    row = -1
    for i in range(n):
        for p in range(start[i] + 1, start[i + 1]):
            larger, side, q = sides[p, 0], sides[p, 1], p - 1
            while q >= start[i] and sides[q, 0] > larger:
                sides[q + 1, 0], sides[q + 1, 1] = sides[q, 0], sides[q, 1]
                q -= 1
            sides[q + 1, 0], sides[q + 1, 1] = larger, side
        for p in range(start[i], start[i + 1]):
            if p == start[i] or sides[p, 0] != sides[p - 1, 0]:
                row += 1
            rows[sides[p, 1]] = row
    return rows.reshape(m, 3)


@njit(cache=True, nogil=True)
def _find(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _join(parent, i, j):
    i, j = _find(parent, i), _find(parent, j)
    if i < j:
        parent[j] = i
    elif j < i:
        parent[i] = j


@njit(cache=True, nogil=True)
def _wings(F, n):
    """For each vertex its incident faces' other corners, in pairs (next, previous)."""
    start = np.zeros(n + 1, dtype=np.int64)
    for f in range(F.shape[0]):
        for c in range(3):
            start[F[f, c] + 1] += 2
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    wings = np.empty(start[n], dtype=np.int32)
    for f in range(F.shape[0]):
        for c in range(3):
            i = F[f, c]
            wings[fill[i]] = F[f, (c + 1) % 3]
            wings[fill[i] + 1] = F[f, (c + 2) % 3]
            fill[i] += 2
    return start, wings


@njit(cache=True, nogil=True)
def _is_one_fan(around, link):
    """Do the faces around a vertex hang together through its edges?

    `around` holds their other corners in pairs, `link` is scratch of the same length.
    """
    d = around.shape[0]
    for p in range(d):
        link[p] = p
        for q in range(p):
            if around[q] == around[p]:
                link[p] = q
                break
    for p in range(0, d, 2):
        _join(link, p, p + 1)
    together = True
    for p in range(1, d):
        together = together and _find(link, p) == _find(link, 0)
    return together


@njit(cache=True, nogil=True)
def _connectivity(F, n):
    start, wings = _wings(F, n)
    widest = 0
    for i in range(n):
        widest = max(widest, start[i + 1] - start[i])
    link, order = np.empty(widest, dtype=np.int64), np.empty(widest, dtype=np.int64)
    parent = np.arange(n).astype(np.int32)
    rim = np.full(n, -1, dtype=np.int32)  # union-find of the boundary's vertices
    edges, boundary_edges = 0, 0
    crowded = np.full(3, -1, dtype=np.int64)
    split, oriented = -1, True
    for i in range(n):
        around = wings[start[i] : start[i + 1]]
        d = around.shape[0]
        if split == -1 and not _is_one_fan(around, link[:d]):
            split = i
        # Twice the neighbour, plus one if the face runs from it to i: sorted, an edge's faces
        # come together, and two that run the same way are equal.
        for p in range(d):
            key, q = 2 * np.int64(around[p]) + p % 2, p - 1
            while q >= 0 and order[q] > key:
                order[q + 1] = order[q]
                q -= 1
            order[q + 1] = key
        p = 0
        while p < d:
            j, faces = order[p] // 2, 1
            while p + faces < d and order[p + faces] // 2 == j:
                if order[p + faces] == order[p + faces - 1]:
                    oriented = False
                faces += 1
            if j > i:
                edges += 1
                _join(parent, i, j)
                if faces > crowded[2] and faces > 2:
                    crowded[0], crowded[1], crowded[2] = i, j, faces
                if faces == 1:
                    boundary_edges += 1
                    for end in (np.int64(i), j):
                        if rim[end] == -1:
                            rim[end] = end
                    _join(rim, i, j)
            p += faces
    components, loops = 0, 0
    component = np.empty(n, dtype=np.int32)
    for i in range(n):
        root = _find(parent, i)
        if root == i:
            component[i] = components
            components += 1
        else:
            component[i] = component[root]  # roots are the smallest of their set
        if rim[i] == i:
            loops += 1
    return edges, boundary_edges, component, components, loops, crowded, split, oriented
