"""Solves of one system that follow each other, as targets move: a drag.

A solve begins at the shape, the rotations, the weights of softened triangles and the multipliers of
constraints that the last one ended with, and goes on as that one did as far as this brings the targets
nearer: where they stop, or turn, so does the shape. What is left of the targets' move takes the shape along
as the quadratic energy of the Laplacian asks for, with no rotation fitted before: handles that go alone would
tear the rotations around them along. Quasi-Newton steps follow, at least two. They begin with the pairs of
earlier solves, for the energy's curvature hardly changes from one to the next, and only a second step tells
what there is to learn from the first. What lags in a drag are slow modes, which plain steps hardly move:
the more pairs, the more of these they know.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.solver.local_global import LocalGlobal
from sshade.solver.quasi_newton import ENERGY_ROUNDING, QuasiNewton, largest_move
from sshade.solver.solution import Solution
from sshade.threads import ThreadTeam

#: Iterations of a solve at least, where targets have moved and its cutoff allows.
LEAST = 2


class Following:
    """A :class:`LocalGlobal` solver, and the state that goes from solve to solve.

    Parameters
    ----------
    solver : LocalGlobal
        With a factorisation.
    positions : (n, 3) float64
    rotations : (n, 3, 3) float64
        Where to begin, as of a solution; hard handles go to their targets first.
    targets : (k, 3) float64
        Of the handle vertices there.
    prescribed, fraction, volume_goal
        There; as of :meth:`LocalGlobal.solve`.
    window : int
        Quasi-Newton steps that are remembered.
    **energy
        See :data:`sshade.options.ENERGY`.

    Raises
    ------
    InputError
        As :meth:`LocalGlobal.solve`, and where the solver goes by multigrid.
    """

    def __init__(
        self,
        solver: LocalGlobal,
        positions: np.ndarray,
        rotations: np.ndarray,
        targets: np.ndarray,
        *,
        prescribed: tuple[np.ndarray, np.ndarray] | None = None,
        fraction: np.ndarray | None = None,
        volume_goal: float = 1.0,
        window: int = 10,
        **energy: Any,
    ) -> None:
        if (factorised := solver.system.factorised) is None:
            raise InputError("a solver that follows moving targets needs a factorisation, not multigrid")
        targets, positions = solver.checked_positions(targets, positions)
        self.solver, self._factorised, team = solver, factorised, ThreadTeam(1)
        self._held, self._iteration = solver.iteration(
            targets, team=team, volume_goal=volume_goal, prescribed=prescribed, fraction=fraction, **energy
        )
        self._iteration.begin_with(rotations)
        self._u = solver.to_system(positions, targets)
        self._iteration.local_step(self._u)
        self._last_u, self._move = self._u.copy(), np.empty_like(self._u)
        self._targets = self._last_targets = targets
        unit = solver.mesh.diagonal
        self._mixer = QuasiNewton(len(self._u), window, self._iteration.gradient, unit=unit, single=True)
        self._has_directions = False

    def solve(
        self,
        targets: np.ndarray,
        *,
        prescribed: tuple[np.ndarray, np.ndarray] | None = None,
        fraction: np.ndarray | None = None,
        volume_goal: float = 1.0,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
    ) -> Solution:
        """As :meth:`LocalGlobal.solve`, from where the last solve ended.

        Parameters
        ----------
        targets : (k, 3) float64
        prescribed, fraction, volume_goal, tolerance, max_iterations
        """
        solver, iteration, u = self.solver, self._iteration, self._u
        targets, _ = solver.checked_positions(targets, None)
        iteration.aim(targets - solver.mesh.origin, volume_goal, prescribed=prescribed, fraction=fraction)
        moved = not np.array_equal(targets, self._targets)
        if max_iterations > 0:
            self._go_on(targets, fraction)
        self._mixer.cut()
        facts = self._iterate(tolerance, max_iterations, least=LEAST if moved else 1)
        return solver.solution(iteration, u, targets, self._held, volume_goal, facts)

    def _go_on(self, targets: np.ndarray, fraction: np.ndarray | None) -> None:
        """Repeat the last move, or a part of it, or take back as much, and go to the targets from there."""
        system, u, last = self.solver.system, self._u, self._targets - self._last_targets
        move, square = targets - self._targets, float((last * last).sum())
        part = float(np.clip((move * last).sum() / square, -1.0, 1.0)) if square > 0 else 0.0
        np.subtract(u, self._last_u, out=self._move)
        self._last_u[:] = u
        self._last_targets, self._targets = self._targets, targets
        if part:
            self._move *= part
            u += self._move
        factorised, soft = self._factorised, system.soft
        held = targets[system.hard] - self.solver.mesh.origin
        pull = system.pull if fraction is None else system.pull * fraction[soft]
        right = np.zeros_like(u)
        right[system.pulled] = pull[:, None] * (move - part * last)[soft]
        free = system.place[factorised.free]
        X = right[free] - factorised.to_handles @ (held - u[system.held])
        factorised.factorisation.solve_ordered(X)
        u[free] += X
        u[system.held] = held
        if self._has_directions:
            self._iteration.restore(u)
        else:
            self._iteration.project(u)
            self._has_directions = True

    def _iterate(self, tolerance: float, max_iterations: int, *, least: int) -> dict[str, Any]:
        """As :func:`sshade.solver.quasi_newton.iterate`, but the last step is a quasi-Newton one as well."""
        u, mixer, iteration, system = self._u, self._mixer, self._iteration, self.solver.system
        g, slack = np.empty_like(u), ENERGY_ROUNDING * abs(system.rest_energy)
        first = energy = iteration.local_step(u)
        residuals: list[float] = []
        rejected, converged = 0, False
        while not converged and len(residuals) < max_iterations:
            before = energy
            iteration.global_step(u, g)
            residuals.append(float(largest_move(g, u)) / system.mesh.diagonal)
            if not np.isfinite(residuals[-1]):
                raise FloatingPointError(f"the positions are not finite after {len(residuals)} iterations")
            converged = residuals[-1] < tolerance and len(residuals) >= least
            mixed = mixer.advance(u, g)
            if mixed:
                iteration.restore(u)
            energy = iteration.local_step(u)
            if mixed and not (energy <= before + slack and iteration.restored):
                rejected += 1
                mixer.halve(u)
                iteration.restore(u)
                energy = iteration.local_step(u)
                if not (energy <= before + slack and iteration.restored):
                    mixer.fall_back(u)
                    energy = iteration.local_step(u)
        return {
            "iterations": len(residuals),
            "residual": residuals[-1] if residuals else np.inf,
            "residual_curve": np.array(residuals),
            "energy": system.rest_energy + energy,
            "energy_initial": system.rest_energy + first,
            "converged": converged,
            "rejected": rejected,
        }
