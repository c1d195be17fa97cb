"""The edges of a mesh as a graph with lengths, on which distances are measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.mesh import Mesh

#: Length of an edge between coincident vertices, as a fraction of the mean length: above the rounding of any
#: sum of lengths.
SHORTEST = 1e-9


@dataclass(frozen=True, eq=False)
class VertexGraph:
    """The edges of a mesh as a graph with lengths, in compressed sparse rows.

    Parameters
    ----------
    indptr : (n + 1,) int32
    indices : (2e,) int32
        Neighbours of each vertex, in ascending order.
    lengths : (2e,) float64
        Euclidean edge lengths, in the mesh's unit, the same bits in both directions. Zero only if all
        vertices coincide.
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
        """(n,) bool: vertices with an edge on the boundary."""
        return np.bincount(self.indices[self.boundary], minlength=self.n) > 0

    @property
    def matrix(self) -> csr_array:
        """(n, n) symmetric sparse float64 lengths."""
        return csr_array((self.lengths, self.indices, self.indptr), shape=(self.n, self.n))


def vertex_graph(mesh: Mesh) -> VertexGraph:
    """Return the graph of the edges of any mesh, weighted by their lengths.

    An edge between coincident vertices gets the length :data:`SHORTEST` times the mean, so that each of
    the two vertices can be a sample with a cell of its own.
    """
    near = mesh.connectivity.neighbours
    lengths = np.empty(len(near.indices))
    in_ranges(_lengths, mesh.n, mesh.V, near.indptr, near.indices, lengths)
    if not lengths.all():
        lengths[lengths == 0.0] = SHORTEST * lengths.mean()
    return VertexGraph(near.indptr, near.indices, lengths, near.boundary)


@kernel
def _lengths(first, end, V, indptr, indices, lengths):
    for i in range(first, end):
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            dx, dy, dz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
            lengths[p] = np.sqrt(dx * dx + dy * dy + dz * dz)
