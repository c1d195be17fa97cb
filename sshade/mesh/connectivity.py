"""Components, boundary loops, manifoldness and orientation of faces, in linear time and memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.mesh.adjacency import sides_by_edge


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
        Ends of the first edge with the most faces, and their number, if that is above two; else -1.
    oriented : bool
        No two faces run through an edge in the same direction.
    split_vertex : int
        The first vertex whose faces form more than one fan; -1 if none.
    """

    edges: int
    boundary_edges: int
    component: np.ndarray
    components: int
    boundary_loops: int
    crowded_edge: np.ndarray
    oriented: bool
    split_vertex: int


def connectivity(F: np.ndarray, n: int) -> Connectivity:
    """Count edges, components and boundary loops, and look for what no oriented manifold has.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; every vertex in some face.
    n : int
        Number of vertices.
    """
    facts = (*_connectivity(F, n, *sides_by_edge(F, n)), _split_vertex(F, n))
    return Connectivity(*facts)


@njit(cache=True, nogil=True)
def _root(parent, i):
    """The representative of i's set, the smallest of its members; paths are halved on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _unite(parent, i, j):
    i, j = _root(parent, i), _root(parent, j)
    parent[max(i, j)] = min(i, j)


@njit(cache=True, nogil=True)
def _connectivity(F, n, ends, start, side):
    """As of :class:`Connectivity`, but for the fans."""
    corner = F.ravel()
    component, loop = np.arange(n).astype(np.int32), np.arange(n).astype(np.int32)
    on_boundary = np.zeros(n, dtype=np.bool_)
    boundary_edges, crowded, oriented = 0, np.full(3, -1, dtype=np.int64), True
    for e in range(ends.shape[0]):
        i, j, faces = ends[e, 0], ends[e, 1], start[e + 1] - start[e]
        _unite(component, i, j)
        if faces == 1:
            boundary_edges += 1
            on_boundary[i] = on_boundary[j] = True
            _unite(loop, i, j)
        elif faces > max(2, crowded[2]):
            crowded[0], crowded[1], crowded[2] = i, j, faces
        forward = 0
        for p in range(start[e], start[e + 1]):
            forward += corner[side[p]] == i
        oriented = oriented and forward < 2 and faces - forward < 2
    number, components, loops = np.empty(n, dtype=np.int32), 0, 0
    for i in range(n):
        root = _root(component, i)
        if root == i:
            number[i] = components
            components += 1
        else:
            number[i] = number[root]  # a root is the first of its set
        loops += on_boundary[i] and loop[i] == i
    return ends.shape[0], boundary_edges, number, components, loops, crowded, oriented


@njit(cache=True, nogil=True)
def _split_vertex(F, n):
    """The first vertex whose neighbours are not all linked to each other by its faces; or -1."""
    m = F.shape[0]
    start = np.zeros(n + 1, dtype=np.int64)
    for f in range(m):
        for c in range(3):
            start[F[f, c] + 1] += 2
    widest = start.max()
    for i in range(n):
        start[i + 1] += start[i]
    fill, around = start[:-1].copy(), np.empty(6 * m, dtype=np.int32)  # two neighbours from each face
    for f in range(m):
        for c in range(3):
            p = fill[F[f, c]]
            around[p], around[p + 1] = F[f, (c + 1) % 3], F[f, (c + 2) % 3]
            fill[F[f, c]] += 2
    place, link = np.full(n, -1, dtype=np.int32), np.empty(widest, dtype=np.int32)
    for i in range(n):
        begin, count, fans = start[i], start[i + 1] - start[i], 0
        for p in range(count):
            j = around[begin + p]
            if place[j] == -1:
                place[j] = p
                fans += 1
            link[p] = place[j]
        for p in range(0, count, 2):
            a, b = _root(link, p), _root(link, p + 1)
            if a != b:
                link[max(a, b)] = min(a, b)
                fans -= 1
        for p in range(count):
            place[around[begin + p]] = -1
        if fans > 1:
            return i
    return -1
