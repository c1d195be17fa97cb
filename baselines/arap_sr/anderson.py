"""Anderson acceleration of a fixed-point iteration.

Y. Peng, B. Deng, J. Zhang, F. Geng, W. Qin, L. Liu, "Anderson acceleration for
geometry optimization and physics simulation", ACM TOG 37(4), 2018.
"""

from __future__ import annotations

import numpy as np
from numba import njit

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
        self._last_F, self.plain = np.empty(size), np.empty(size)
        self._dF, self._dG = np.zeros((window, size)), np.zeros((window, size))
        self._gram = np.zeros((window, window))

    def advance(self, u: np.ndarray, g: np.ndarray) -> None:
        """Replace u by the accelerated iterate, or by g in the first call. :attr:`plain` keeps g.

        Parameters
        ----------
        u : (size,) float64
            Overwritten.
        g : (size,) float64
            Plain iterate g(u).
        """
        _advance(u, g, self._count, self._last_F, self.plain, self._dF, self._dG, self._gram)
        self._count += 1


@njit(cache=True, nogil=True)
def _advance(u, g, count, last_F, last_g, dF, dG, gram):
    window, size = dF.shape
    used = min(count, window)
    if count > 0:
        newest = (count - 1) % window
        for i in range(size):
            F = g[i] - u[i]
            dF[newest, i] = F - last_F[i]
            dG[newest, i] = g[i] - last_g[i]
            last_F[i] = F
            last_g[i] = g[i]
        for c in range(used):
            gram[newest, c] = gram[c, newest] = _inner(dF[newest], dF[c])
    else:
        for i in range(size):
            last_F[i] = g[i] - u[i]
            last_g[i] = g[i]
    u[:] = g
    if used > 0:
        target = np.empty(used)
        for c in range(used):
            target[c] = _inner(dF[c], last_F)
        theta = _least_squares(gram[:used, :used], target)
        for c in range(used):
            if theta[c] != 0.0:
                for i in range(size):
                    u[i] -= theta[c] * dG[c, i]


@njit(cache=True, nogil=True)
def _least_squares(gram, target):
    """Solve the normal equations of unit-length columns by a pivoted Cholesky factorisation.

    The coefficient of a column that depends on earlier columns is zero.
    """
    n = len(target)
    scale, chosen, L = np.zeros(n), np.empty(n, dtype=np.int64), np.zeros((n, n))
    pivot, y, theta = np.zeros(n), np.zeros(n), np.zeros(n)
    for c in range(n):
        if gram[c, c] > 0.0:
            scale[c] = 1.0 / np.sqrt(gram[c, c])
            pivot[c] = 1.0
    rank = 0
    while rank < n:
        p = np.argmax(pivot)
        if pivot[p] <= DEPENDENT:
            break
        chosen[rank] = p
        root = np.sqrt(pivot[p])
        L[p, rank] = root
        pivot[p] = 0.0
        for c in range(n):
            if pivot[c] > 0.0:
                value = gram[c, p] * scale[c] * scale[p]
                for k in range(rank):
                    value -= L[c, k] * L[p, k]
                L[c, rank] = value / root
                pivot[c] = max(pivot[c] - L[c, rank] * L[c, rank], 0.0)
        value = target[p] * scale[p]
        for k in range(rank):
            value -= L[p, k] * y[k]
        y[rank] = value / root
        rank += 1
    for a in range(rank - 1, -1, -1):
        value = y[a]
        for b in range(a + 1, rank):
            value -= L[chosen[b], a] * theta[chosen[b]]
        theta[chosen[a]] = value / L[chosen[a], a]
    for c in range(n):
        theta[c] *= scale[c]
    return theta


@njit(cache=True, nogil=True)
def _inner(a, b):
    """Return the dot product from four partial sums, because additions to one sum wait for each other."""
    s0 = s1 = s2 = s3 = 0.0
    end = len(a) - len(a) % 4
    for i in range(0, end, 4):
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(end, len(a)):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)
