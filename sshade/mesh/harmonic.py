"""Harmonic functions on the vertices of a mesh: smooth interpolation of values known at some vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import cg

from sshade.mesh.adjacency import VertexGraph

#: Edges shorter than this fraction of the mean length get the weight of an edge of this length.
SHORT = 0.1
#: Relative residual at which conjugate gradients stop.
TOLERANCE = 1e-6


def harmonic(graph: VertexGraph, free: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at free vertices such that each is the weighted mean of its neighbours' values.

    The weight of an edge is 1 / length. Up to :data:`TOLERANCE`, the results lie between the least and
    the largest known value.

    Parameters
    ----------
    graph : VertexGraph
        A path must lead from each free vertex to a vertex with known values.
    free : (f,) int
        Vertices whose values are computed.
    values : (n, d) float64
        Known values at the other vertices; rows of free vertices are ignored.

    Returns
    -------
    (f, d) float64
    """
    weight = 1.0 / np.maximum(graph.lengths, SHORT * graph.lengths.mean())
    rows = csr_array((weight, graph.indices, graph.indptr), shape=(graph.n, graph.n))[free]
    degree = rows.sum(axis=1)
    known = values.copy()
    known[free] = 0.0
    laplacian = diags_array(degree, format="csr") - rows[:, free]
    jacobi, right_sides = diags_array(1.0 / degree), rows @ known
    return np.stack([cg(laplacian, b, rtol=TOLERANCE, M=jacobi)[0] for b in right_sides.T], axis=1)
