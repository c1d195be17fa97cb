"""Functions on a mesh's vertices that are as even as what is known of them allows."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import cg

from sshade.mesh.adjacency import VertexGraph

#: Length of an edge, over the mean, from which on shorter ones weigh no more.
SHORT = 0.1
#: Relative residual to which the equations are solved.
TOLERANCE = 1e-6


def harmonic(graph: VertexGraph, free: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at some vertices, each the mean of its neighbours' with weights of 1 / length of the edge.

    None exceeds what the known ones span, to the tolerance of the solution, conjugate gradients.

    Parameters
    ----------
    graph : VertexGraph
        In which a path leads from each free vertex to one that is not.
    free : (f,) int
    values : (n, d) float64
        Known at the other vertices.

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
    jacobi, pulled = diags_array(1.0 / degree), rows @ known
    return np.stack([cg(laplacian, column, rtol=TOLERANCE, M=jacobi)[0] for column in pulled.T], axis=1)
