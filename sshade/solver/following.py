"""Solves of one system that follow each other, as targets move: a drag.

A solve begins at the shape, the rotations, the weights of softened triangles and the multipliers of
constraints that the last one ended with, and goes on as that one did as far as this brings the targets
nearer: where they stop, or turn, so does the shape. Its first step is a plain one. Handles are taken
to their targets by its global step only, as alone they would tear the rotations around them along. The later
ones are quasi-Newton steps, which begin with the pairs of earlier solves, for the energy's curvature
hardly changes from one to the next.
"""

from __future__ import annotations

from math import inf
from typing import Unpack

import numpy as np

from sshade.errors import InputError
from sshade.progress import silent
from sshade.solver.local_global import LocalGlobal
from sshade.solver.options import EnergyOptions
from sshade.solver.quasi_newton import QuasiNewton, iterate
from sshade.solver.solution import Solution
from sshade.threads import ThreadTeam


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
    known, share, volume_goal
        There; as of :meth:`LocalGlobal.solve`.
    window : int
        Quasi-Newton steps that are remembered.
    **energy
        See :class:`sshade.solver.options.EnergyOptions`.

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
        known: tuple[np.ndarray, np.ndarray] | None = None,
        share: np.ndarray | None = None,
        volume_goal: float = 1.0,
        window: int = 5,
        **energy: Unpack[EnergyOptions],
    ) -> None:
        if solver.system.factorised is None:
            raise InputError("a solver that follows moving targets needs a factorisation, not multigrid")
        targets, positions = solver.checked_positions(targets, positions)
        self.solver, team = solver, ThreadTeam(1)
        self._held, self._iteration = solver.iteration(
            targets, team=team, volume_goal=volume_goal, known=known, share=share, **energy
        )
        self._iteration.begin_with(rotations)
        self._u = solver.to_system(positions, targets)
        self._iteration.local_step(self._u)
        self._last_u, self._move = self._u.copy(), np.empty_like(self._u)
        self._targets = self._last_targets = targets
        self._mixer = QuasiNewton(len(self._u), window, self._iteration.gradient, team=team)

    def solve(
        self,
        targets: np.ndarray,
        *,
        known: tuple[np.ndarray, np.ndarray] | None = None,
        share: np.ndarray | None = None,
        volume_goal: float = 1.0,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
    ) -> Solution:
        """As :meth:`LocalGlobal.solve`, from where the last solve ended.

        Parameters
        ----------
        targets : (k, 3) float64
        known, share, volume_goal, tolerance, max_iterations
        """
        solver, iteration, u = self.solver, self._iteration, self._u
        targets, _ = solver.checked_positions(targets, None)
        iteration.aim(targets - solver.mesh.origin, volume_goal, known=known, share=share)
        if max_iterations > 0:
            self._go_on(targets)
        self._mixer.cut()
        facts = iterate(
            iteration,
            u,
            mixer=self._mixer,
            tolerance=tolerance,
            max_iterations=max_iterations,
            deadline=inf,
            progress=silent,
            plain=1,
        )
        return solver.solution(iteration, u, targets, self._held, volume_goal, facts)

    def _go_on(self, targets: np.ndarray) -> None:
        """Repeat the last move, or a share of it, or take back as much, so that targets are nearest."""
        u, last = self._u, self._targets - self._last_targets
        move, square = targets - self._targets, float((last * last).sum())
        share = float(np.clip((move * last).sum() / square, -1.0, 1.0)) if square > 0 else 0.0
        np.subtract(u, self._last_u, out=self._move)
        self._last_u[:] = u
        self._last_targets, self._targets = self._targets, targets
        if share:
            self._move *= share
            u += self._move
