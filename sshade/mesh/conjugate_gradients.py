"""Preconditioned conjugate gradients for several right sides at once.

M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of Research
of the National Bureau of Standards 49, 1952.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

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
