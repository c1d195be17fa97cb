"""Components, boundary loops, manifoldness and orientation of faces, in linear time and memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.mesh.neighbours import Neighbours, neighbours


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
    neighbours : Neighbours
        Of each vertex.
    """

    edges: int
    boundary_edges: int
    component: np.ndarray
    components: int
    boundary_loops: int
    crowded_edge: np.ndarray
    oriented: bool
    split_vertex: int
    neighbours: Neighbours


def connectivity(F: np.ndarray, n: int) -> Connectivity:
    """Count edges, components and boundary loops, and look for what no oriented manifold has.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; every vertex in some face.
    n : int
        Number of vertices.
    """
    near, fans = neighbours(F, n)
    component, components = _components(near.indptr, near.indices)
    rim, loops = _boundary(near.indptr, near.indices, near.boundary)
    return Connectivity(len(near.indices) // 2, rim, component, components, loops, *fans, near)


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
def _components(indptr, indices):
    """The component of each vertex, numbered by first vertex, and their number."""
    n = indptr.shape[0] - 1
    parent = np.arange(n).astype(np.int32)
    for i in range(n):
        own = i
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            if j > i:
                break
            if parent[j] == own:
                continue  # as of most: no need to look for the root
            root = _root(parent, j)
            parent[max(own, root)] = min(own, root)
            own = min(own, root)
    number, components = np.empty(n, dtype=np.int32), 0
    for i in range(n):
        if parent[i] == i:
            number[i] = components
            components += 1
        else:
            number[i] = number[parent[i]]  # which comes before, and has its number
    return number, components


@njit(cache=True, nogil=True)
def _boundary(indptr, indices, boundary):
    """The number of edges on the boundary, and of connected sets of them."""
    n = indptr.shape[0] - 1
    loop, rim, loops = np.arange(n).astype(np.int32), 0, 0
    on_boundary = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        for p in range(indptr[i], indptr[i + 1]):
            if boundary[p] and indices[p] > i:
                rim += 1
                on_boundary[i] = on_boundary[indices[p]] = True
                _unite(loop, i, indices[p])
    for i in range(n):
        loops += on_boundary[i] and loop[i] == i
    return rim, loops


def members(labels: np.ndarray, count: int) -> list[np.ndarray]:
    """For each label in [0, count) the places (p,) that have it, in ascending order."""
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.cumsum(np.bincount(labels, minlength=count)))[:count]
