"""Who is next to whom: the sides of faces by edge, the faces around vertices, the graph of the edges.

Every table is made by counting sort, in time and memory linear in the number of faces, however
many faces meet at one vertex. A list of lists is stored as two arrays: that of row i are the
entries from ``start[i]`` to ``start[i + 1]`` of the other one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from sshade.threads import in_ranges

if TYPE_CHECKING:
    from sshade.mesh.mesh import Mesh


#: Length of an edge without any, over the mean: short, and above the rounding of any sum of lengths.
SHORTEST = 1e-9


class EdgeSides(NamedTuple):
    """The undirected edges of faces, and the sides of faces that lie at each.

    Side ``3 f + c`` of face f goes from its corner c to the next one: sides 0, 1
    and 2 from corner 0 to 1, 1 to 2, and 2 to 0.

    Attributes
    ----------
    ends : (e, 2) int32
        Vertices of each edge, the smaller id first, in lexicographic order.
    start : (e + 1,) int32
        Where the sides of each edge begin in `side`.
    side : (3m,) int32
        In ascending order within an edge.
    """

    ends: np.ndarray
    start: np.ndarray
    side: np.ndarray

    @property
    def faces(self) -> np.ndarray:
        """(e,) int32 number of faces at each edge."""
        return np.diff(self.start)

    @property
    def edge(self) -> np.ndarray:
        """(m, 3) int64 edge of each side of each face."""
        edge = np.empty(len(self.side), dtype=np.int64)
        edge[self.side] = np.repeat(np.arange(len(self.ends)), self.faces)
        return edge.reshape(-1, 3)

    @property
    def twin(self) -> np.ndarray:
        """(3m,) int32 the other side at the edge of each side; -1 unless the edge has two faces."""
        first = self.start[:-1][self.faces == 2]
        one, other = self.side[first], self.side[first + 1]
        twin = np.full(len(self.side), -1, dtype=np.int32)
        twin[one], twin[other] = other, one
        return twin


def sides_by_edge(F: np.ndarray, n: int) -> EdgeSides:
    """Sort the sides of faces by edge.

    Parameters
    ----------
    F : (m, 3) int
        No repeated index within a face; otherwise any.
    n : int
        Number of vertices.
    """
    return EdgeSides(*_sides_by_edge(F, n))


@dataclass(frozen=True, eq=False)
class VertexGraph:
    """The edges of a mesh as a graph with lengths, in compressed sparse rows.

    Parameters
    ----------
    indptr : (n + 1,) int32
    indices : (2e,) int32
        Neighbours of each vertex, in ascending order.
    lengths : (2e,) float64
        Euclidean edge lengths, the same bits in both directions; 0 only if all vertices coincide.
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

    @cached_property
    def on_boundary(self) -> np.ndarray:
        """(n,) bool: which vertices have an edge on the boundary."""
        found = np.zeros(self.n, dtype=bool)
        found[np.searchsorted(self.indptr, np.flatnonzero(self.boundary), side="right") - 1] = True
        return found

    @property
    def matrix(self) -> csr_array:
        """(n, n) symmetric sparse float64 lengths."""
        return csr_array((self.lengths, self.indices, self.indptr), shape=(self.n, self.n))


def vertex_graph(mesh: Mesh) -> VertexGraph:
    """The graph of a mesh's edges, weighted by their lengths.

    An edge without length has :data:`SHORTEST` times the mean one, so that vertices in one place
    are apart: each can be a sample with a region of its own.

    Raises
    ------
    InputError
        Unless the mesh is manifold and consistently oriented.
    """
    mesh.require_manifold()
    return edge_graph(mesh)


def edge_graph(mesh: Mesh) -> VertexGraph:
    """The same graph of any mesh, manifold and oriented or not."""
    near = mesh.connectivity.neighbours
    lengths = np.empty(len(near.indices))
    in_ranges(lambda first, end: _lengths(first, end, mesh.V, near.indptr, near.indices, lengths), mesh.n)
    if not lengths.all():
        lengths[lengths == 0.0] = SHORTEST * lengths.mean()
    return VertexGraph(near.indptr, near.indices, lengths, near.boundary)


@njit(cache=True, nogil=True)
def _starts(ids, n):
    """(n + 1,) int64 where the entries of each of n ids begin once they are sorted."""
    start = np.zeros(n + 1, dtype=np.int64)
    for i in ids:
        start[i + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    return start


@njit(cache=True, nogil=True)
def _sides_by_edge(F, n):
    """Sort by the larger end, then, keeping that order among equals, by the smaller one."""
    m = F.shape[0]
    low, high = np.empty(3 * m, dtype=np.int32), np.empty(3 * m, dtype=np.int32)
    for f in range(m):
        for c in range(3):
            i, j = F[f, c], F[f, (c + 1) % 3]
            low[3 * f + c], high[3 * f + c] = min(i, j), max(i, j)
    # A start is moved along with what is filled in: in the end it is where the entries end.
    by_high, by_low = _starts(high, n), _starts(low, n)
    partly, its_low = np.empty(3 * m, dtype=np.int32), np.empty(3 * m, dtype=np.int32)
    for s in range(3 * m):
        p = by_high[high[s]]
        partly[p], its_low[p] = s, low[s]
        by_high[high[s]] += 1
    side, its_high = low, high  # not needed any more
    p = 0
    for j in range(n):
        while p < by_high[j]:
            q = by_low[its_low[p]]
            side[q], its_high[q] = partly[p], j
            by_low[its_low[p]] += 1
            p += 1
    ends, start = np.empty((3 * m, 2), dtype=np.int32), np.empty(3 * m + 1, dtype=np.int32)
    edges = p = 0
    for i in range(n):
        begin = p
        while p < by_low[i]:
            if p == begin or its_high[p] != its_high[p - 1]:
                ends[edges, 0], ends[edges, 1], start[edges] = i, its_high[p], p
                edges += 1
            p += 1
    start[edges] = 3 * m
    return ends[:edges], start[: edges + 1], side


@njit(cache=True, nogil=True)
def faces_around_vertices(F, n):
    """List the faces at each of n vertices.

    Parameters
    ----------
    F : (m, 3) int
    n : int

    Returns
    -------
    start : (n + 1,) int64
    face : (3m,) int64
        In ascending order for each vertex.
    """
    start = _starts(F.ravel(), n)
    fill, face = start[:-1].copy(), np.empty(F.size, dtype=np.int64)
    for f in range(F.shape[0]):
        for i in F[f]:
            face[fill[i]] = f
            fill[i] += 1
    return start, face


@njit(cache=True, nogil=True)
def _lengths(first, end, V, indptr, indices, lengths):
    for i in range(first, end):
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            dx, dy, dz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
            lengths[p] = np.sqrt(dx * dx + dy * dy + dz * dz)
