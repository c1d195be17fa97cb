"""Quasi-Newton steps between those of a local/global iteration: L-BFGS in the metric of its Laplacian.

A plain iteration from u ends in ``g = u - L^-1 G`` with the energy's gradient G at u,
up to a factor: a descent step whose metric L is that of the rest shape. What L does
not know of the energy, the last steps tell. Under exact constraints u and g are both
on the constraint surface, and G is the gradient of the Lagrangian, as far as steps
along the surface can tell.

T. Liu, S. Bouaziz, L. Kavan, "Quasi-Newton methods for real-time simulation of
hyperelastic materials", ACM TOG 36(3), 2017; J. Nocedal, "Updating quasi-Newton
matrices with limited storage", Mathematics of Computation 35, 1980.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

#: Cosine between a step and the change of the gradient along it, below which it tells nothing.
CURVED = 1e-10
#: Numbers that are worked on at a time.
BLOCK = 1024


class QuasiNewton:
    """Proposes iterates from the plain ones before.

    Parameters
    ----------
    n : int
        Number of vertices.
    window : int
        How many steps are remembered.
    product : callable
        ``product(F, out)`` writes L F to `out`, both (n, 3) float64.

    Attributes
    ----------
    plain : (n, 3) float64
        The last plain iterate.
    """

    def __init__(self, n: int, window: int, product: Callable[[np.ndarray, np.ndarray], None]) -> None:
        self._product, self._window = product, window
        self.plain = np.empty((n, 3))
        self._last_u, self._F, self._G, self._last_F, self._last_G = np.zeros((5, n, 3))
        self._S, self._Y, self._Z = np.zeros((3, window, n, 3))
        self._curvature = np.zeros(window)
        self._way, self._q = np.empty((n, 3)), np.empty((n, 3))
        self._begun, self._steps = False, 0

    def advance(self, u: np.ndarray, g: np.ndarray) -> bool:
        """Replace u (n, 3) by the next iterate, for g (n, 3), one plain iteration from u.

        Returns
        -------
        bool
            False where that is g: nothing is remembered, or what is leads uphill.
        """
        self.plain[:] = g
        np.subtract(g, u, out=self._F)
        self._product(self._F, self._G)
        if self._begun:
            slot = self._steps % self._window
            pair = self._S[slot], self._Y[slot], self._Z[slot]
            now, last = (u, self._F, self._G), (self._last_u, self._last_F, self._last_G)
            curvature = _curvature(u, self._last_u, self._G, self._last_G)
            if curvature > 0.0:
                _remember(*now, *last, *pair)
                self._curvature[slot] = curvature
                self._steps += 1
        self._begun = True
        self._last_u[:] = u
        self._F, self._last_F = self._last_F, self._F
        self._G, self._last_G = self._last_G, self._G
        stored = min(self._steps, self._window)
        newest_first = (self._steps - 1 - np.arange(stored)) % self._window
        pairs = self._S, self._Y, self._Z, self._curvature
        if stored and _direction(self._last_F, self._last_G, *pairs, newest_first, self._q, self._way):
            u += self._way
            return True
        self._steps = 0
        u[:] = g
        return False

    def half(self, u: np.ndarray) -> None:
        """Replace u (n, 3) by the middle of the last step that was no plain one."""
        u[:] = self._last_u + 0.5 * self._way


@njit(cache=True, nogil=True)
def largest_move(A, B):
    """Return ``max_i |A_i - B_i|`` of two (n, 3) arrays; NaN where one has NaN."""
    largest = 0.0
    for i in range(len(A)):
        x, y, z = A[i, 0] - B[i, 0], A[i, 1] - B[i, 1], A[i, 2] - B[i, 2]
        square = x * x + y * y + z * z
        if not square <= largest:  # also true for NaN, which then stays
            largest = square
            if np.isnan(square):
                break
    return np.sqrt(largest)


@njit(cache=True, nogil=True)
def _curvature(u, last_u, G, last_G):
    """``s . y`` of the step s and the gradient's change y = last_G - G along it; 0 where it tells nothing.

    G is ``L (g - u)``: the gradient, but for its sign.
    """
    u, last_u, G, last_G = u.reshape(-1), last_u.reshape(-1), G.reshape(-1), last_G.reshape(-1)
    dot = ss = yy = 0.0
    for i in range(len(u)):
        s, y = u[i] - last_u[i], last_G[i] - G[i]
        dot += s * y
        ss += s * s
        yy += y * y
    return dot if dot > CURVED * np.sqrt(ss * yy) else 0.0


@njit(cache=True, nogil=True)
def _remember(u, F, G, last_u, last_F, last_G, S, Y, Z):
    """Write the step, the gradient's change, and L^-1 of that."""
    _subtract(u.reshape(-1), last_u.reshape(-1), S.reshape(-1))
    _subtract(last_G.reshape(-1), G.reshape(-1), Y.reshape(-1))
    _subtract(last_F.reshape(-1), F.reshape(-1), Z.reshape(-1))


@njit(cache=True, nogil=True)
def _direction(F, G, S, Y, Z, curvature, newest_first, q, way):
    """Write the quasi-Newton step to `way`; False where it does not descend.

    The usual two loops, upwards in sign: q begins as G, minus the gradient, and
    `way`, L^-1 q all along, as F. Block by block, so that what one pass leaves in
    the cache the dot product for the next finds there.
    """
    F, G, q, way = F.reshape(-1), G.reshape(-1), q.reshape(-1), way.reshape(-1)
    size, last = len(q), len(newest_first) - 1
    share = np.empty(last + 1)
    q[:] = G
    way[:] = F
    dot = inner(S[newest_first[0]].reshape(-1), q)
    for k in range(last + 1):
        p = newest_first[k]
        share[k] = dot / curvature[p]
        y, z = Y[p].reshape(-1), Z[p].reshape(-1)
        other = S[newest_first[k + 1]].reshape(-1) if k < last else y
        dot = 0.0
        for begin in range(0, size, BLOCK):
            own = slice(begin, min(begin + BLOCK, size))
            _add(-share[k], y[own], q[own])
            _add(-share[k], z[own], way[own])
            dot += inner(other[own], q[own] if k < last else way[own])
    for k in range(last, -1, -1):
        p = newest_first[k]
        change, s = share[k] - dot / curvature[p], S[p].reshape(-1)
        other = Y[newest_first[k - 1]].reshape(-1) if k > 0 else G
        dot = 0.0
        for begin in range(0, size, BLOCK):
            own = slice(begin, min(begin + BLOCK, size))
            _add(change, s[own], way[own])
            dot += inner(other[own], way[own])
    return dot > 0.0


@njit(cache=True, nogil=True)
def _subtract(a, b, out):
    for i in range(len(a)):
        out[i] = a[i] - b[i]


@njit(cache=True, nogil=True)
def _add(share, a, b):
    for i in range(len(a)):
        b[i] += share * a[i]


@njit(cache=True, nogil=True)
def inner(a, b):
    """Dot product in four partial sums: in a single one each addition waits for the last."""
    s0 = s1 = s2 = s3 = 0.0
    n = len(a)
    end = n - n % 4
    for i in range(0, end, 4):
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(end, n):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)
