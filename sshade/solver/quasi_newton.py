"""Quasi-Newton steps between those of a local/global iteration: L-BFGS in the metric of its Laplacian.

A plain iteration from u ends in ``g = u - L^-1 G`` with the energy's gradient G at u,
up to a factor: a descent step in the metric L of the rest shape. L-BFGS corrects L^-1
by the pairs (s, y) of the last steps and the gradient's changes along them. Under exact
constraints u and g are both on the constraint surface, and the component of G tangential
to it is that of the Lagrangian's gradient.

T. Liu, S. Bouaziz, L. Kavan, "Quasi-Newton methods for real-time simulation of
hyperelastic materials", ACM TOG 36(3), 2017; J. Nocedal, "Updating quasi-Newton
matrices with limited storage", Mathematics of Computation 35, 1980.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from numba import njit

from sshade.solver.arap import ArapIteration
from sshade.task import Progress

#: A rise of the energy below this (x the rest shape's Dirichlet energy) is rounding, not a bad step.
ENERGY_ROUNDING = 1e-14
#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10
#: Cosine between a step and the change of the gradient along it, up to which the pair is not stored.
CURVED = 1e-10
#: Numbers that are worked on at a time.
BLOCK = 1024


class QuasiNewton:
    """Computes the next iterate from a plain one and the last steps.

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
        self._u, self._F, self._G, *self._spare = np.zeros((5, n, 3))
        self._S, self._Y, self._Z = np.zeros((3, window, n, 3))
        self._curvature = np.zeros(window)
        self._step, self._q = np.empty((n, 3)), np.empty((n, 3))
        self._begun, self._steps = False, 0

    def advance(self, u: np.ndarray, g: np.ndarray) -> bool:
        """Replace u (n, 3) by the next iterate, for g (n, 3), one plain iteration from u.

        Returns
        -------
        bool
            False where that is g: no pair is stored, or the step does not descend.
        """
        self.plain[:] = g
        F, G = self._spare
        np.subtract(g, u, out=F)
        self._product(F, G)
        if self._begun:
            slot = self._steps % self._window
            curvature = _curvature(u, self._u, G, self._G)
            if curvature > 0.0:
                np.subtract(u, self._u, out=self._S[slot])
                np.subtract(self._G, G, out=self._Y[slot])
                np.subtract(self._F, F, out=self._Z[slot])
                self._curvature[slot] = curvature
                self._steps += 1
        self._begun = True
        self._u[:] = u
        self._spare, self._F, self._G = [self._F, self._G], F, G
        stored = min(self._steps, self._window)
        newest_first = (self._steps - 1 - np.arange(stored)) % self._window
        pairs = self._S, self._Y, self._Z, self._curvature
        if stored and _direction(F, G, *pairs, newest_first, self._q, self._step):
            u += self._step
            return True
        self._steps = 0
        u[:] = g
        return False

    def halve(self, u: np.ndarray) -> None:
        """Replace u (n, 3) by the middle of the last quasi-Newton step."""
        u[:] = self._u + 0.5 * self._step


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
        The fields of :class:`sshade.solver.local_global.Solution` that the iteration determines.

    Raises
    ------
    FloatingPointError
        When an iterate is not finite.
    """
    rest_energy, diagonal = iteration.system.rest_energy, iteration.system.mesh.diagonal
    g, slack = u.copy(), ENERGY_ROUNDING * abs(rest_energy)
    iterations, rejected, residual, mixed = 0, 0, np.inf, False
    energies, residuals = [np.inf], []
    while True:
        energy = iteration.local_step(u)
        if mixer and mixed and not (energy <= energies[-1] + slack and iteration.restored):
            rejected += 1
            mixer.halve(u)
            iteration.restore(u)
            energy = iteration.local_step(u)
            if not (energy <= energies[-1] + slack and iteration.restored):
                u[:] = mixer.plain
                energy = iteration.local_step(u)
        energies.append(energy)
        if residual < tolerance or iterations >= max_iterations or perf_counter() >= deadline:
            break
        iteration.global_step(u, g)
        residual = float(largest_move(g, u)) / diagonal
        residuals.append(residual)
        iterations += 1
        if not np.isfinite(residual):
            raise FloatingPointError(f"the positions are not finite after {iterations} iterations")
        mixed = False
        if mixer and residual >= tolerance and iterations < max_iterations:
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
        "converged": residual < tolerance,
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
def _curvature(u, last_u, G, last_G):
    """``s . y`` of the step s and the gradient's change y = last_G - G along it; 0 up to :data:`CURVED`.

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
def _direction(F, G, S, Y, Z, curvature, newest_first, q, step):
    """Write the quasi-Newton step to `step`; False where it does not descend.

    The usual two loops, upwards in sign: q begins as G, minus the gradient, and
    `step`, L^-1 q all along, as F. Block by block, so that what one pass leaves in
    the cache the dot product for the next finds there.
    """
    F, G, q, step = F.reshape(-1), G.reshape(-1), q.reshape(-1), step.reshape(-1)
    size, last = len(q), len(newest_first) - 1
    share = np.empty(last + 1)
    q[:] = G
    step[:] = F
    dot = _inner(S[newest_first[0]].reshape(-1), q)
    for k in range(last + 1):
        p = newest_first[k]
        share[k] = dot / curvature[p]
        y, z = Y[p].reshape(-1), Z[p].reshape(-1)
        other = S[newest_first[k + 1]].reshape(-1) if k < last else y
        dot = 0.0
        for begin in range(0, size, BLOCK):
            own = slice(begin, min(begin + BLOCK, size))
            _add(-share[k], y[own], q[own])
            _add(-share[k], z[own], step[own])
            dot += _inner(other[own], q[own] if k < last else step[own])
    for k in range(last, -1, -1):
        p = newest_first[k]
        change, s = share[k] - dot / curvature[p], S[p].reshape(-1)
        other = Y[newest_first[k - 1]].reshape(-1) if k > 0 else G
        dot = 0.0
        for begin in range(0, size, BLOCK):
            own = slice(begin, min(begin + BLOCK, size))
            _add(change, s[own], step[own])
            dot += _inner(other[own], step[own])
    return dot > 0.0


@njit(cache=True, nogil=True)
def _add(share, a, b):
    for i in range(len(a)):
        b[i] += share * a[i]


@njit(cache=True, nogil=True)
def _inner(a, b):
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
