"""Anderson acceleration of a fixed-point iteration.

Y. Peng, B. Deng, J. Zhang, F. Geng, W. Qin, L. Liu, "Anderson acceleration for
geometry optimization and physics simulation", ACM TOG 37(4), 2018.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpstrf

#: Least pivot of unit columns; a difference with a smaller pivot depends on the other differences.
DEPENDENT = 1e-12


class Anderson:
    """Extrapolation of the sequence ``u -> g(u)`` from its last steps.

    Let F(u) = g(u) - u, and let dF and dG be the last differences of F and g. The next iterate is
    ``g(u) - dG theta``, where theta minimises ``|F - dF theta|``.

    Parameters
    ----------
    size : int
        Number of scalar unknowns.
    window : int
        Number of differences that are kept.
    """

    def __init__(self, size: int, window: int) -> None:
        self._count = 0
        self._F, self._g = np.empty(size), np.empty(size)
        self._dF, self._dG = np.zeros((window, size)), np.zeros((window, size))
        self._gram = np.zeros((window, window))

    def advance(self, u: np.ndarray, g: np.ndarray) -> None:
        """Replace u by the accelerated iterate, or by g in the first call.

        Parameters
        ----------
        u : (size,) float64
            Overwritten.
        g : (size,) float64
            Plain iterate g(u).
        """
        F = g - u
        u[:] = g
        if self._count > 0:
            newest = (self._count - 1) % len(self._dF)
            used = min(self._count, len(self._dF))
            self._dF[newest], self._dG[newest] = F - self._F, g - self._g
            dF, gram = self._dF[:used], self._gram[:used, :used]
            # Unlike `@`, einsum gives the same bits with any number of threads.
            gram[newest] = gram[:, newest] = np.einsum("cs,s->c", dF, dF[newest])
            theta = _least_squares(gram, np.einsum("cs,s->c", dF, F))
            u -= np.einsum("c,cs->s", theta, self._dG[:used])
        self._F, self._g, self._count = F, g.copy(), self._count + 1


def _least_squares(gram: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Solve the normal equations of unit-length columns with the columns of a pivoted Cholesky factorisation.

    The coefficient of a column that depends on earlier columns is zero.
    """
    length = np.sqrt(np.diag(gram))
    scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    unit = scale[:, None] * gram * scale
    _, order, rank, _ = dpstrf(unit, tol=DEPENDENT)
    chosen, theta = order[:rank] - 1, np.zeros(len(target))
    theta[chosen] = np.linalg.solve(unit[np.ix_(chosen, chosen)], (target * scale)[chosen])
    return theta * scale
