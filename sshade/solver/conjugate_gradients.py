"""Conjugate gradients for Laplacians, three columns at once, preconditioned by V-cycles.

M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of
Research of the National Bureau of Standards 49, 1952.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.solver.multigrid import Multigrid, multiply
from sshade.threads import ThreadTeam

#: Steps at most; three or four are usual, and each leaves a fifth of the error.
MOST_STEPS = 40


def conjugate_gradients(
    multigrid: Multigrid,
    B: np.ndarray,
    X: np.ndarray,
    *,
    held: np.ndarray,
    tolerance: float,
    team: ThreadTeam,
) -> None:
    """Write A^-1 B to X, nearly, for the matrix A that cycles are of.

    Parameters
    ----------
    multigrid : Multigrid
    B, X : (n, 3) float64
        As of :meth:`Multigrid.apply`, but not the same.
    held : (k,) int
        Rows that are left out.
    tolerance : float
        Of the energy norm of what each column is off, over that of the column, as cycles estimate both.
        A has single precision.
    team : ThreadTeam
    """
    multigrid.apply(B, X, team=team)
    A, n = multigrid.finest, len(B)
    if A is None:
        return
    P, R, Q = X.copy(), B.copy(), np.empty_like(B)
    X[:] = 0.0

    def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.sum(team.ranges(lambda *own: _products(*own, one, other), n), axis=0)

    def divided(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.divide(one, other, out=np.zeros(3), where=other > 0)

    start = now = product(R, P)
    for _ in range(MOST_STEPS):
        team.ranges(lambda *own: multiply(*own, *A, P, Q), n)
        Q[held] = 0.0
        step = divided(now, product(P, Q))
        team.ranges(lambda *own, step=step: _add(*own, step, P, Q, X, R), n)
        multigrid.apply(R, Q, team=team)
        now, last = product(R, Q), now
        if (now <= tolerance**2 * start).all():
            break
        share = divided(now, last)
        team.ranges(lambda *own, share=share: _turn(*own, share, Q, P), n)


@njit(cache=True, nogil=True)
def _products(first, end, A, B):
    """Of each column."""
    sums = np.zeros(3)
    for i in range(first, end):
        for c in range(3):
            sums[c] += A[i, c] * B[i, c]
    return sums


@njit(cache=True, nogil=True)
def _add(first, end, step, P, Q, X, R):
    """``X += step P``, ``R -= step Q``."""
    for i in range(first, end):
        for c in range(3):
            X[i, c] += step[c] * P[i, c]
            R[i, c] -= step[c] * Q[i, c]


@njit(cache=True, nogil=True)
def _turn(first, end, share, Q, P):
    """``P = Q + share P``."""
    for i in range(first, end):
        for c in range(3):
            P[i, c] = Q[i, c] + share[c] * P[i, c]
