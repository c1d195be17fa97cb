"""Harmonic functions on the vertices of a mesh: smooth interpolation of values known at some vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

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
    return _solved(laplacian, rows @ known, degree[:, None])


def _solved(A: csr_array, B: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """Solve ``A X = B`` for B (f, d) by conjugate gradients with the diagonal (f, 1) of A.

    Sums avoid BLAS: its threads change the last digits, and wait for each other on a busy machine.
    """

    def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.einsum("ic,ic->c", one, other)

    def divided(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.divide(one, other, out=np.zeros(len(one)), where=other > 0)

    X, R, P = np.zeros_like(B), B.copy(), B / diagonal
    now, limit = product(R, P), TOLERANCE**2 * product(B, B)
    for _ in range(10 * len(B)):
        if (product(R, R) <= limit).all():
            break
        Q = A @ P
        step = divided(now, product(P, Q))
        X += step * P
        R -= step * Q
        Z = R / diagonal
        now, last = product(R, Z), now
        P = Z + divided(now, last) * P
    return X
