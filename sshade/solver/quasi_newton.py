"""Quasi-Newton steps between those of a local/global iteration: L-BFGS in the metric of its global step.

A plain iteration from u ends in ``g = u - M G`` with the energy's gradient G at u, up to a
factor: a descent step in the metric M^-1, the Laplacian L of the rest shape or close to it
(:mod:`sshade.solver.global_step`). L-BFGS corrects M by the pairs (s, y) of the last steps and the
gradient's changes along them. Under exact constraints u and g are both on the constraint
surface, and the component of G tangential to it is that of the Lagrangian's gradient.

The usual two loops run over scalars: of y only ``z = M y`` is stored, the difference of two plain
moves, and what they ask for are products s.y, z.y, s.G and z.G, one new row of each at a step. So
each stored array is read twice a step, by as many threads as there are. Sums are by blocks and then
by chunks of a size of their own: the same bits with any number of threads. Pairs and gradients may have
single precision, which halves memory and its traffic: they only say where to go, and how far it went
down is for the energy to say; sums of their products have double.

T. Liu, S. Bouaziz, L. Kavan, "Quasi-Newton methods for real-time simulation of
hyperelastic materials", ACM TOG 36(3), 2017; J. Nocedal, "Updating quasi-Newton
matrices with limited storage", Mathematics of Computation 35, 1980; W. Chen, Z. Wang, J. Zhou,
"Large-scale L-BFGS using MapReduce", NIPS 2014 (the loops over scalars).
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from numba import njit

from sshade.progress import Progress
from sshade.solver.arap import ArapIteration
from sshade.threads import ThreadTeam

#: A rise of the energy below this (x the rest shape's Dirichlet energy) is rounding, not a bad step.
ENERGY_ROUNDING = 1e-14
#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10
#: Cosine between a step and the change of the gradient along it, up to which the pair is not stored.
CURVED = 1e-10
#: In place of a pair's number.
NONE = -1
#: Numbers that are worked on at a time, and by a thread.
BLOCK, CHUNK = 1024, 96 * 1024


class QuasiNewton:
    """Computes the next iterate from a plain one and the last steps.

    Parameters
    ----------
    n : int
        Number of vertices.
    window : int
        How many steps are remembered.
    product : callable
        ``product(F)`` gives M^-1 F for a plain move F, both (n, 3) float64, in an array that may be reused.
    unit : float
        About the size of positions: what is stored is over it.
    single : bool
        Store in single precision.
    team : ThreadTeam, optional
        Threads that share the work.
    """

    def __init__(
        self,
        n: int,
        window: int,
        product: Callable[[np.ndarray], np.ndarray],
        *,
        unit: float = 1.0,
        single: bool = False,
        team: ThreadTeam | None = None,
    ) -> None:
        self._product, self._window, self._team = product, window, team or ThreadTeam(1)
        self._per_unit = 1.0 / unit
        self._u, self._F = np.zeros((2, 3 * n))
        precision = np.float32 if single else np.float64
        self._G = np.zeros(3 * n, dtype=precision)
        self._S, self._Z = np.empty((2, window, 3 * n), dtype=precision)
        self._sy, self._zy = np.zeros((2, window, window))
        self._along_z, self._along_s = np.empty((2, window))
        self._begun, self._steps = False, 0

    def advance(self, u: np.ndarray, g: np.ndarray) -> bool:
        """Replace u (n, 3) by the next iterate, for g (n, 3), one plain iteration from u; g is overwritten.

        Returns
        -------
        bool
            False where that is the plain one: no pair is stored, or the step does not descend.
        """
        F, flat = g.reshape(-1), u.reshape(-1)
        self._sum(lambda own: _subtract(*own, flat, F))
        product = self._product(g).reshape(-1)
        descends = self._directed(flat, F, product)
        self._begun = True
        if descends:
            self._move(u, 1.0)
        else:
            self.fall_back(u)
        return descends

    def cut(self) -> None:
        """Make no pair of the last iterate and the next: what they minimise is not the same."""
        self._begun = False

    def halve(self, u: np.ndarray) -> None:
        """Replace u (n, 3) by the middle of the last quasi-Newton step."""
        self._move(u, 0.5)

    def fall_back(self, u: np.ndarray) -> None:
        """Replace u (n, 3) by the last plain iterate."""
        np.add(self._u, self._F, out=u.reshape(-1))

    def _directed(self, u: np.ndarray, F: np.ndarray, product: np.ndarray) -> bool:
        """Store the new pair, if it curves upwards, and find the step; False where there is none.

        u, F and the product become the last ones.
        """
        last, window, new = (self._u, self._F, self._G), self._window, NONE
        sums = self._sum(lambda own: _curvature(*own, self._per_unit, u, last[0], product, last[2]))
        if self._begun and sums[0] > CURVED * np.sqrt(sums[1] * sums[2]):
            new = self._steps % window
            self._steps += 1
        self._pairs = (self._steps - 1 - np.arange(min(self._steps, window))) % window
        stored = self._S, self._Z, self._pairs, new
        rows = self._sum(lambda own: _products(*own, self._per_unit, u, F, product, *last, *stored))
        if new != NONE:
            self._sy[self._pairs, new] = rows[:-1, 0]
            self._zy[self._pairs, new] = self._zy[new, self._pairs] = rows[:-1, 1]
        if len(self._pairs) == 0:
            return False
        shares = self._along_s, self._along_z
        descends = _two_loops(self._sy, self._zy, rows[:, 2], rows[:, 3], self._pairs, *shares)
        self._steps *= descends
        return descends

    def _move(self, u: np.ndarray, share: float) -> None:
        """Write the last iterate and a share of the step to u."""
        step = self._F, self._S, self._Z, self._pairs, self._along_s, self._along_z
        flat = u.reshape(-1)
        self._sum(lambda own: _add_step(*own, share, self._per_unit, self._u, *step, flat))

    def _sum(self, part: Callable[[tuple[int, int]], Any]) -> Any:
        """The sum of what a kernel returns for each chunk of the numbers."""
        size = len(self._F)
        bounds = [*range(0, size, CHUNK), size]
        parts = self._team(lambda number: part((bounds[number], bounds[number + 1])), len(bounds) - 1)
        return sum(parts[1:], start=parts[0])


def iterate(
    iteration: ArapIteration,
    u: np.ndarray,
    *,
    mixer: QuasiNewton | None,
    tolerance: float,
    max_iterations: int,
    deadline: float,
    progress: Progress,
) -> dict[str, Any]:
    """Repeat a plain iteration, accelerated by a mixer, until its residual is below a tolerance.

    Parameters
    ----------
    iteration : ArapIteration
    u : (n, 3) float64
        Where to begin; replaced by the last iterate.
    mixer : QuasiNewton, optional
    tolerance, max_iterations
        See :meth:`sshade.solver.local_global.LocalGlobal.solve`.
    deadline : float
        Value of `perf_counter` after which no iteration begins.
    progress : Progress

    Returns
    -------
    dict
        The fields of :class:`sshade.solver.solution.Solution` that the iteration determines.

    Raises
    ------
    FloatingPointError
        When an iterate is not finite.
    """
    rest_energy, diagonal = iteration.system.rest_energy, iteration.system.mesh.diagonal
    g, slack = u.copy(), ENERGY_ROUNDING * abs(rest_energy)
    iterations, rejected, residual, mixed, converged = 0, 0, np.inf, False, False
    energies, residuals = [np.inf], []
    while True:
        energy = iteration.local_step(u)
        if mixer and mixed and not (energy <= energies[-1] + slack and iteration.restored):
            rejected += 1
            mixer.halve(u)
            iteration.restore(u)
            energy = iteration.local_step(u)
            if not (energy <= energies[-1] + slack and iteration.restored):
                mixer.fall_back(u)
                energy = iteration.local_step(u)
        energies.append(energy)
        if converged or iterations >= max_iterations or perf_counter() >= deadline:
            break
        rough = iteration.rough
        iteration.global_step(u, g)
        residual = float(largest_move(g, u)) / diagonal
        residuals.append(residual)
        iterations += 1
        if not np.isfinite(residual):
            raise FloatingPointError(f"the positions are not finite after {iterations} iterations")
        mixed, converged = False, residual < tolerance and not rough
        if residual < tolerance and rough:
            iteration.refine()
        if mixer and not converged and iterations < max_iterations:
            mixed = mixer.advance(u, g)
            if mixed:
                iteration.restore(u)
        else:
            u[:] = g
        if iterations % REPORT_EVERY == 0:
            progress("iterations", iterations, max_iterations, f"residual {residual:.1e}")
    progress("iterations", iterations, max_iterations, f"residual {residual:.1e}")
    return {
        "iterations": iterations,
        "residual": residual,
        "residual_curve": np.array(residuals),
        "energy": rest_energy + energies[-1],
        "energy_initial": rest_energy + energies[1],
        "converged": converged,
        "rejected": rejected,
    }


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
def _subtract(first, end, u, g):
    for i in range(first, end):
        g[i] -= u[i]
    return 0


@njit(cache=True, nogil=True)
def _curvature(first, end, per_unit, u, last_u, product, last_G):
    """Products s.y, s.s, y.y of the step s and the gradient's change ``y = last_G - G`` along it.

    The product is minus the gradient; G is the same in units as what is stored, as u and F are not.
    """
    sums = np.zeros(3)
    for i in range(first, end):
        s, y = per_unit * (u[i] - last_u[i]), last_G[i] - per_unit * product[i]
        sums[0] += s * y
        sums[1] += s * s
        sums[2] += y * y
    return sums


# The compiler may sum in an order of its own: in a single sum each addition waits for the last. All sums are
# in this function, as what it calls would be compiled with it or apart from it, in one order or another.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _products(first, end, per_unit, u, F, product, last_u, last_F, last_G, S, Z, pairs, new):
    """Rows of s.y, z.y, s.G, z.G for each pair, with the `new` one's y, which is stored first.

    A last row has F.G in the third place, where F takes that of s. u, F and G replace the last ones.
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


@njit(cache=True, nogil=True)
def _two_loops(sy, zy, sG, zG, pairs, along_s, along_z):
    """Write the step's shares of each s and z; False where it does not descend.

    Upwards in sign: q begins as G, minus the gradient, and the step, M q all along, as F.
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


@njit(cache=True, nogil=True)
def _add_step(first, end, share, per_unit, last_u, F, S, Z, pairs, along_s, along_z, u):
    """Write ``last_u + share (F + sum_k along_s s_k + along_z z_k)`` to u."""
    for begin in range(first, end, BLOCK):
        own = slice(begin, min(begin + BLOCK, end))
        u[own] = last_u[own]
        _add(share, F[own], u[own])
        for k in range(len(pairs)):
            _add(share * along_s[k] / per_unit, S[pairs[k]][own], u[own])
            _add(share * along_z[k] / per_unit, Z[pairs[k]][own], u[own])
    return 0


@njit(cache=True, nogil=True)
def _add(share, a, b):
    for i in range(len(a)):
        b[i] += share * a[i]
