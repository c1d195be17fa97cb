"""Harmonic functions on the vertices of a mesh, and the conjugate gradients that find them.

A harmonic function is a smooth interpolation of values known at some vertices.

M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of Research
of the National Bureau of Standards 49, 1952.
"""

from __future__ import annotations

from collections.abc import Callable

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
    B, diagonal = rows @ known, degree[:, None]
    limit = TOLERANCE**2 * _product(B, B)
    return conjugate_gradients(
        B,
        B / diagonal,
        times=lambda P, Q: np.copyto(Q, laplacian @ P),
        precondition=lambda R, Q: np.divide(R, diagonal, out=Q),
        converged=lambda R, now, start: bool((_product(R, R) <= limit).all()),
        product=_product,
        most_steps=10 * len(B),
    )


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    # No BLAS: its threads change the last digits, and wait for each other on a busy machine.
    return np.einsum("ic,ic->c", one, other)


#: ``operator(X, Y)`` writes the result for X (n, d) to Y.
Operator = Callable[[np.ndarray, np.ndarray], None]


def conjugate_gradients(
    B: np.ndarray,
    P: np.ndarray,
    *,
    times: Operator,
    precondition: Operator,
    converged: Callable[[np.ndarray, np.ndarray, np.ndarray], bool],
    product: Callable[[np.ndarray, np.ndarray], np.ndarray],
    most_steps: int,
) -> np.ndarray:
    """Solve ``A X = B`` for a symmetric positive definite A.

    Parameters
    ----------
    B : (n, d) float64
    P : (n, d) float64
        The preconditioner times B; overwritten.
    times, precondition : callable
        A and the preconditioner.
    converged : callable
        ``converged(R, now, start)`` for the residuals R (n, d), and the squares of their norm in the
        preconditioner's metric now and at the start, (d,) each.
    product : callable
        Inner products (d,) of the columns of two arrays (n, d). It must add in the same order for any
        number of threads, unlike BLAS.
    most_steps : int

    Returns
    -------
    X : (n, d) float64
    """
    X, R, Q = np.zeros_like(B), B.copy(), np.empty_like(B)
    start = now = product(R, P)
    for _ in range(most_steps):
        times(P, Q)
        step = _divided(now, product(P, Q))
        X += step * P
        R -= step * Q
        precondition(R, Q)
        now, last = product(R, Q), now
        if converged(R, now, start):
            break
        np.add(Q, _divided(now, last) * P, out=P)
    return X


def _divided(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Divide where the divisor is positive; 0 elsewhere, for right sides that are solved exactly."""
    return np.divide(one, other, out=np.zeros_like(one), where=other > 0)
