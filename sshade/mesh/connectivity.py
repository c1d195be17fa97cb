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
    split_vertex : int
        The first vertex whose faces form more than one fan; -1 if none.
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
    """Count edges, components and boundary loops, and look for what no oriented manifold has.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; every vertex in some face.
    n : int
        Number of vertices.
    """
    return Connectivity(*_connectivity(F.ravel(), n, *sides_by_edge(F, n)))


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
def _connectivity(corner, n, ends, start, side):
    """As of :class:`Connectivity`, for the (3m,) vertices at the corners of faces."""
    component, loop = np.arange(n).astype(np.int32), np.arange(n).astype(np.int32)
    fan = np.arange(corner.shape[0]).astype(np.int32)  # sets of the corners at a vertex
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
        forward, at_i, at_j = 0, -1, -1
        for p in range(start[e], start[e + 1]):
            tail = np.int64(side[p])
            head = tail - 2 if tail % 3 == 2 else tail + 1
            forward += corner[tail] == i
            last_i, last_j = at_i, at_j
            at_i, at_j = (tail, head) if corner[tail] == i else (head, tail)
            if p > start[e]:
                _unite(fan, last_i, at_i)
                _unite(fan, last_j, at_j)
        oriented = oriented and forward < 2 and faces - forward < 2
    fans = np.zeros(n, dtype=np.int32)
    for s in range(corner.shape[0]):
        fans[corner[s]] += fan[s] == s
    number, components, loops, split = np.empty(n, dtype=np.int32), 0, 0, -1
    for i in range(n):
        root = _root(component, i)
        if root == i:
            number[i] = components
            components += 1
        else:
            number[i] = number[root]  # a root is the first of its set
        loops += on_boundary[i] and loop[i] == i
        if fans[i] > 1 and split == -1:
            split = i
    return ends.shape[0], boundary_edges, number, components, loops, crowded, split, oriented
