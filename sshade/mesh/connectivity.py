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
    edges = sides_by_edge(F, n)
    return Connectivity(*_connectivity(F, n, *edges, edges.twin))


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
def _connectivity(F, n, ends, start, side, twin):
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
    split = _split_vertex(corner, n, twin)
    return ends.shape[0], boundary_edges, number, components, loops, crowded, split, oriented


@njit(cache=True, nogil=True)
def _split_vertex(corner, n, twin):
    """The first vertex around which steps from face to face, over the twins of sides, miss a face; or -1."""
    faces, first = np.zeros(n, dtype=np.int32), np.empty(n, dtype=np.int32)
    for s in range(corner.shape[0]):
        faces[corner[s]] += 1
        first[corner[s]] = s
    for i in range(n):
        reached, closed = 1, False
        for way in range(2):
            # Of the two sides at a corner one is its own, the other one that of the corner before.
            s = first[i] if way == 0 else _side_before(first[i])
            while twin[s] != -1 and not closed:
                s = twin[s]
                if corner[s] == i:
                    at, s = s, _side_before(s)
                else:
                    s = s - 2 if s % 3 == 2 else s + 1
                    at = s
                closed = at == first[i]
                reached += not closed
        if reached < faces[i]:
            return i
    return -1


@njit(cache=True, nogil=True)
def _side_before(side):
    return side + 2 if side % 3 == 0 else side - 1
