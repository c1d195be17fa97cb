"""The loop around a plain iteration: residual, acceleration and its safeguard, cutoffs."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from sshade.solver.elements import Iteration
from sshade.solver.quasi_newton import QuasiNewton, largest_move
from sshade.task import Progress

#: A rise of the energy below this (x the rest shape's Dirichlet energy) is rounding, not a bad step.
ENERGY_ROUNDING = 1e-14
#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10


def iterate(
    iteration: Iteration,
    u: np.ndarray,
    *,
    mixer: QuasiNewton | None,
    tolerance: float,
    max_iterations: int,
    deadline: float,
    progress: Progress,
) -> dict[str, Any]:
    """Iterate from u (n, 3), in place; return what a solution tells of it."""
    g, slack = u.copy(), ENERGY_ROUNDING * abs(iteration.rest_energy)
    iterations, rejected, residual, mixed = 0, 0, np.inf, False
    energies, residuals = [np.inf], []
    while True:
        energy = iteration.local_step(u)
        if mixer and mixed and not (energy <= energies[-1] + slack and iteration.restored):
            rejected += 1
            mixer.half(u)
            iteration.restore(u)
            energy = iteration.local_step(u)
            if not (energy <= energies[-1] + slack and iteration.restored):
                u[:] = mixer.plain
                energy = iteration.local_step(u)
        energies.append(energy)
        if residual < tolerance or iterations >= max_iterations or perf_counter() >= deadline:
            break
        iteration.global_step(u, g)
        residual = float(largest_move(g, u)) / iteration.diagonal
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
        "energy": iteration.rest_energy + energies[-1],
        "energy_initial": iteration.rest_energy + energies[1],
        "converged": residual < tolerance,
        "rejected": rejected,
    }
