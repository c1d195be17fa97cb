"""Quasi-Newton steps between plain local/global iterations: L-BFGS in the metric of the global step.

A plain iteration from u ends in ``g = u - M G`` with the energy's gradient G at u, up to a factor. It is a
descent step in the metric M^-1, which is the Laplacian L of the rest shape or close to it
(:mod:`sshade.solver.factorisation`). L-BFGS corrects M by pairs (s, y): the last steps and the changes of the
gradient along them. Under exact constraints, u and g both lie on the constraint surface, and the component
of G tangential to it is that of the Lagrangian's gradient.

The two loops of L-BFGS run over scalars. Instead of y, ``z = M y`` is stored, the difference of two plain
moves. The loops need the products s.y, z.y, s.G and z.G, with one new row of each in a step, so that each
stored array is read twice a step, by all threads. Sums are over blocks and then over chunks of constant size:
they have the same bits with any number of threads. Pairs and gradients may have single precision, which
halves memory and its traffic. They only give a direction, and the energy decides about the step. Sums of
their products have double precision.

T. Liu, S. Bouaziz, L. Kavan, "Quasi-Newton methods for real-time simulation of hyperelastic materials", ACM
TOG 36(3), 2017; J. Nocedal, "Updating quasi-Newton matrices with limited storage", Mathematics of Computation
35, 1980; W. Chen, Z. Wang, J. Zhou, "Large-scale L-BFGS using MapReduce", NIPS 2014 (the loops over scalars).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import ThreadTeam

#: Number of stored steps: of a solve; of a polish, where a larger number takes more memory and gave no better
#: results on six bodies; and of a drag, see :mod:`sshade.solver.drag`.
WINDOW, WINDOW_OF_POLISH, WINDOW_OF_DRAG = 5, 4, 10
#: Least cosine between a step and the change of the gradient along it for which the pair is stored.
CURVED = 1e-10
#: Number that stands for "no pair".
NONE = -1
#: Number of coordinates that a kernel works on at a time. A thread takes half of all coordinates at a time,
#: but at least LEAST and at most CHUNK of them. :func:`_curvature` and :func:`_add_step` do little work, so
#: their threads take at least LEAST_SHORT.
BLOCK, LEAST, LEAST_SHORT, CHUNK = 1024, 9 * 1024, 48 * 1024, 96 * 1024


class QuasiNewton:
    """Computes the next iterate from a plain one and the last steps.

    Signs: in the text above, G is the gradient. In the code, G is minus the gradient, divided by the unit,
    and `product` is minus the gradient in the mesh's unit. So ``F = g - u`` is M times `product`, the change
    of the gradient is ``y = last_G - G``, and ``z = M y`` is ``last_F - F``.

    Parameters
    ----------
    n : int
        Number of vertices.
    window : int
        Number of stored steps. More steps save iterations and cost memory.
    unit : float
        Typical size of positions; stored arrays are divided by it.
    single : bool
        Store in single precision.
    team : ThreadTeam, optional
        Threads that share the work.
    """

    def __init__(
        self,
        n: int,
        window: int,
        *,
        unit: float = 1.0,
        single: bool = False,
        team: ThreadTeam | None = None,
    ) -> None:
        self._window, self._team = window, team or ThreadTeam(1)
        self._per_unit = 1.0 / unit
        self._u, self._F = np.zeros((2, 3 * n))
        precision = np.float32 if single else np.float64
        self._G = np.zeros(3 * n, dtype=precision)
        self._S, self._Z = np.empty((2, window, 3 * n), dtype=precision)
        self._sy, self._zy = np.zeros((2, window, window))
        self._along_z, self._along_s = np.empty((2, window))
        self._begun, self._steps = False, 0

    def advance(self, u: np.ndarray, g: np.ndarray, force: np.ndarray) -> bool:
        """Replace u by the next iterate.

        Parameters
        ----------
        u : (n, 3) float64
        g : (n, 3) float64
            Plain iterate from u; overwritten.
        force : (n, 3) float64
            ``M^-1 (g - u)``, minus the gradient at u up to a factor.

        Returns
        -------
        bool
            False if the next iterate is g: no pair is stored, or the quasi-Newton step does not descend.
        """
        F, flat, product = g.reshape(-1), u.reshape(-1), force.reshape(-1)
        F -= flat
        descends = self._directed(flat, F, product)
        self._begun = True
        if descends:
            self.move(u, 1.0)
        else:
            self.fall_back(u)
        return descends

    def cut(self) -> None:
        """Store no pair of the last iterate and the next one, because the energy changes in between."""
        self._begun = False

    def fall_back(self, u: np.ndarray) -> None:
        """Replace u (n, 3) by the last plain iterate."""
        np.add(self._u, self._F, out=u.reshape(-1))

    def _directed(self, u: np.ndarray, F: np.ndarray, product: np.ndarray) -> bool:
        """Store the new pair if the energy curves upwards along it, and find the step; False without a step.

        u, F and `product` become the last iterate, plain move and force.
        """
        last, window, new = (self._u, self._F, self._G), self._window, NONE
        pair = self._per_unit, u, last[0], product, last[2]
        sums = sum(self._chunks(_curvature, *pair, least=LEAST_SHORT))
        if self._begun and sums[0] > CURVED * np.sqrt(sums[1] * sums[2]):
            new = self._steps % window
            self._steps += 1
        self._pairs = (self._steps - 1 - np.arange(min(self._steps, window))) % window
        stored = self._S, self._Z, self._pairs, new
        rows = sum(self._chunks(_products, self._per_unit, u, F, product, *last, *stored))
        if new != NONE:
            self._sy[self._pairs, new] = rows[:-1, 0]
            self._zy[self._pairs, new] = self._zy[new, self._pairs] = rows[:-1, 1]
        if len(self._pairs) == 0:
            return False
        factors = self._along_s, self._along_z
        descends = _two_loops(self._sy, self._zy, rows[:, 2], rows[:, 3], self._pairs, *factors)
        self._steps *= descends
        return descends

    def move(self, u: np.ndarray, fraction: float) -> None:
        """Replace u (n, 3) by the last iterate plus a fraction of the last quasi-Newton step."""
        step = self._F, self._S, self._Z, self._pairs, self._along_s, self._along_z
        self._chunks(_add_step, fraction, self._per_unit, self._u, *step, u.reshape(-1), least=LEAST_SHORT)

    def _chunks(self, kernel: Callable[..., Any], *arguments: Any, least: int = LEAST) -> list[Any]:
        half = -(-len(self._F) // (2 * BLOCK)) * BLOCK
        return self._team.ranges(kernel, len(self._F), *arguments, rows=min(CHUNK, max(least, half)))


# The compiler may reorder these sums, so that an addition need not wait for the last one. All sums of a
# function are in it, because the compiler may inline other functions or not, with different orders.
@kernel(fastmath={"reassoc", "contract"})
def _curvature(first, end, per_unit, u, last_u, product, last_G):
    """Products s.y, s.s, y.y of the step s and the change ``y = last_G - G`` of the gradient along it.

    `product` is minus the gradient, and G is `product` divided by the unit.
    """
    sums = np.zeros(3)
    for i in range(first, end):
        s, y = per_unit * (u[i] - last_u[i]), last_G[i] - per_unit * product[i]
        sums[0] += s * y
        sums[1] += s * s
        sums[2] += y * y
    return sums


@kernel(fastmath={"reassoc", "contract"})
def _products(first, end, per_unit, u, F, product, last_u, last_F, last_G, S, Z, pairs, new):
    """Rows of s.y, z.y, s.G, z.G for each pair, with the y of the pair `new`, which is stored first.

    The last row has F.G in the third place, because F takes the place of s. u, F and G replace the last ones.
    """
    count = len(pairs)
    rows, change, gradient = np.zeros((count + 1, 4)), np.empty(BLOCK), np.empty(BLOCK)
    for begin in range(first, end, BLOCK):
        stop = min(begin + BLOCK, end)
        y, now = change[: stop - begin], gradient[: stop - begin]
        for i in range(begin, stop):
            now[i - begin] = per_unit * product[i]
            y[i - begin] = last_G[i] - now[i - begin]
            last_G[i] = now[i - begin]
        if new != NONE:
            for i in range(begin, stop):
                S[new, i] = per_unit * (u[i] - last_u[i])
                Z[new, i] = per_unit * (last_F[i] - F[i])
        for k in range(count):
            s, z, sy, zy, sg, zg = S[pairs[k], begin:stop], Z[pairs[k], begin:stop], 0.0, 0.0, 0.0, 0.0
            for i in range(len(s)):
                a, b = np.float64(s[i]), np.float64(z[i])
                sy, zy = sy + a * y[i], zy + b * y[i]
                sg, zg = sg + a * now[i], zg + b * now[i]
            rows[k, 0] += sy
            rows[k, 1] += zy
            rows[k, 2] += sg
            rows[k, 3] += zg
        move, down = F[begin:stop], 0.0
        for i in range(len(move)):
            down += move[i] * now[i]
        rows[count, 2] += per_unit * down
        last_u[begin:stop], last_F[begin:stop] = u[begin:stop], F[begin:stop]
    return rows


@kernel
def _two_loops(sy, zy, sG, zG, pairs, along_s, along_z):
    """Write the step's factors of each s and z; False if the step does not descend.

    The signs differ from the textbook: q begins as G, minus the gradient, and the step M q as F.
    """
    count = len(pairs)
    for a in range(count):
        k = pairs[a]
        dot = sG[a]
        for b in range(a):
            dot += along_z[b] * sy[k, pairs[b]]
        along_z[a] = -dot / sy[k, k]
    descent = sG[count]
    for a in range(count - 1, -1, -1):
        k = pairs[a]
        dot = zG[a]
        for b in range(count):
            dot += along_z[b] * zy[k, pairs[b]]
        for b in range(a + 1, count):
            dot += along_s[b] * sy[pairs[b], k]
        along_s[a] = -along_z[a] - dot / sy[k, k]
        descent += along_s[a] * sG[a] + along_z[a] * zG[a]
    return descent > 0.0


@kernel
def _add_step(first, end, fraction, per_unit, last_u, F, S, Z, pairs, along_s, along_z, u):
    """Write ``last_u + fraction (F + sum_k along_s s_k + along_z z_k)`` to u."""
    for begin in range(first, end, BLOCK):
        own = slice(begin, min(begin + BLOCK, end))
        u[own] = last_u[own]
        _add(fraction, F[own], u[own])
        for k in range(len(pairs)):
            _add(fraction * along_s[k] / per_unit, S[pairs[k]][own], u[own])
            _add(fraction * along_z[k] / per_unit, Z[pairs[k]][own], u[own])


@subroutine
def _add(factor, a, b):
    for i in range(len(a)):
        b[i] += factor * a[i]
