"""The edges of a mesh as a graph with lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class VertexGraph:
    """The edges of a mesh as a compressed sparse row structure.

    Parameters
    ----------
    indptr : (n + 1,) int32
    indices : (2e,) int32
        Neighbours of each vertex, in ascending order.
    lengths : (2e,) float64
        Euclidean edge lengths.
    boundary : (2e,) bool
        True where the edge has a single face.
    """

    indptr: np.ndarray
    indices: np.ndarray
    lengths: np.ndarray
    boundary: np.ndarray

    @property
    def n(self) -> int:
        """Number of vertices."""
        return len(self.indptr) - 1


def vertex_graph(mesh: Mesh) -> VertexGraph:
    """The edge graph of a mesh; O(n).

    Raises
    ------
    InputError
        Unless the mesh is manifold and consistently oriented.
    """
    mesh.require_manifold()
    return VertexGraph(*_vertex_graph(mesh.V, mesh.F))


@njit(cache=True, nogil=True)
def _vertex_graph(V, F):
    """Rows of neighbours of an oriented manifold mesh; each face gives each corner its next one.

    Around an inner vertex that lists every neighbour once. The fan of a boundary vertex is open:
    it begins with a corner `a` that precedes no face and ends with one, `b`, that follows none.
    """
    n, m = V.shape[0], F.shape[0]
    ends = np.zeros(n, dtype=np.int32)  # a XOR b: every other neighbour comes twice and cancels
    indptr = np.zeros(n + 1, dtype=np.int32)
    for f in range(m):
        for c in range(3):
            i, after, before = F[f, c], F[f, (c + 1) % 3], F[f, (c + 2) % 3]
            ends[i] ^= np.int32(after) ^ np.int32(before)
            indptr[i + 1] += 1
    for i in range(n):
        indptr[i + 1] += indptr[i] + (1 if ends[i] != 0 else 0)
    indices = np.empty(indptr[n], dtype=np.int32)
    fill = indptr[:-1].copy()
    for f in range(m):
        for c in range(3):
            i = F[f, c]
            indices[fill[i]] = F[f, (c + 1) % 3]
            fill[i] += 1
    boundary = np.zeros(indptr[n], dtype=np.bool_)
    _close_open_fans(F, ends, indptr, indices, fill)
    lengths = np.empty(indptr[n], dtype=np.float64)
    for i in range(n):
        begin, end = indptr[i], indptr[i + 1]
        a, b = -1, -1
        if ends[i] != 0:
            b = indices[end - 1]
            a = ends[i] ^ b
        for p in range(begin + 1, end):
            key, q = indices[p], p - 1
            while q >= begin and indices[q] > key:
                indices[q + 1] = indices[q]
                q -= 1
            indices[q + 1] = key
        for p in range(begin, end):
            j = indices[p]
            boundary[p] = j in (a, b)
            dx, dy, dz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
            lengths[p] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return indptr, indices, lengths, boundary


@njit(cache=True, nogil=True)
def _close_open_fans(F, ends, indptr, indices, fill):
    """Append to each boundary vertex's row the neighbour that follows it in no face."""
    for f in range(F.shape[0]):
        for c in range(3):
            i = F[f, c]
            if ends[i] == 0 or fill[i] == indptr[i + 1]:
                continue
            before = F[f, (c + 2) % 3]
            listed = False
            for p in range(indptr[i], fill[i]):
                listed = listed or indices[p] == before
            if not listed:
                indices[fill[i]] = before
                fill[i] += 1
