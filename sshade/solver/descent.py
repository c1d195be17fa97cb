"""Local/global iterations: local and global steps of an energy, constraints, and quasi-Newton steps."""

from __future__ import annotations

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.problem.majority import MajorityMotion
from sshade.problem.options import Options
from sshade.solver.constraints import Constraints
from sshade.solver.energy import Energy, Prescribed
from sshade.solver.factorisation import Factorised, Linear
from sshade.solver.quasi_newton import QuasiNewton
from sshade.solver.run import largest_move
from sshade.solver.system import System

#: Rise of the energy, as a fraction of the rest energy, that counts as rounding.
ENERGY_ROUNDING = 1e-14


class Descent:
    """The state of local/global iterations; a :class:`sshade.solver.run.IterationState`.

    One object may serve several solves in a row, as targets move. Each solve begins with the positions,
    rotations, strain weights, multipliers of constraints and quasi-Newton pairs of the end of the last solve.

    The safeguard compares energies after local steps, corrected for the errors of exact constraints. If an
    accelerated iterate has a higher energy than the iterate before, or cannot be projected onto the exact
    constraints, half of its step is tried. The last resort is the plain iterate.

    Parameters
    ----------
    system : System
    options : Options
        `volume` and `area`, the weights of the constraints; `stiffness`, `strain` and `strain_limit`.
    u : (n, 3) float64
        First iterate, in the solver's order; hard handles are on their targets.
    team : ThreadTeam
    window : int
        Number of stored quasi-Newton steps; 0 for plain iterations.
    single : bool
        Store the quasi-Newton steps in single precision.
    accelerate_last : bool
        Take a quasi-Newton step also from the last plain iterate, if another solve follows.
    softened : bool
        Use the Laplacian with the strain weights of the first iterate; see
        :meth:`sshade.solver.system.System.linear`.

    Attributes
    ----------
    u : (n, 3) float64
        The present iterate.
    energy : Energy
    constraints : Constraints
    value, initial_value : float
        Energy at the present iterate and at the beginning of the solve, minus the rest energy.
    rejected : int
        Accelerated iterates given up in this solve.
    volume_goal : float
        Volume to reach, as a multiple of the volume at rest.
    """

    def __init__(
        self,
        system: System,
        options: Options,
        u: np.ndarray,
        *,
        team: ThreadTeam,
        window: int = 0,
        single: bool = False,
        accelerate_last: bool = False,
        softened: bool = False,
    ) -> None:
        self._system, self.energy, self._team = system, Energy(system, options, team=team), team
        self.constraints = Constraints(
            system.surface,
            options.volume,
            options.area,
            corners=system.corners,
            team=team,
            single=system.multigrid and not system.exact_steps,
        )
        self.u, self._g, self._accelerate_last = u, np.empty_like(u), accelerate_last
        self._softened = softened
        self._made: Linear | None = None
        self._quasi_newton: QuasiNewton | None = None
        if window:
            unit = system.mesh.diagonal
            self._quasi_newton = QuasiNewton(len(u), window, unit=unit, single=single, team=team)
        self._slack = ENERGY_ROUNDING * abs(system.rest_energy)

    def aim(
        self,
        targets: np.ndarray,
        prescribed: Prescribed | None,
        fraction: np.ndarray | None,
        volume_goal: float = 1.0,
        majority: MajorityMotion | None = None,
    ) -> None:
        """Set the targets of a solve, as of :meth:`sshade.solver.local_global.LocalGlobal.solve`."""
        self.energy.aim(targets - self._system.mesh.origin, prescribed, fraction, majority)
        self.aim_volume(volume_goal)

    def begin(self, tolerance: float) -> None:
        """Fit the rotations to the present iterate, where a solve with a tolerance begins."""
        self.constraints.begin(tolerance)
        if self._quasi_newton:
            self._quasi_newton.cut()
        self.value = self.initial_value = self._local_step()
        self.rejected = 0

    def _local_step(self, *, restored: bool = False) -> float:
        """Fit the rotations; return the energy. If `restored`, :meth:`restore` has just been called."""
        return self.energy.local_step(self.u) + self.constraints.penalty(self.u, restored=restored)

    @property
    def _linear(self) -> Linear:
        """The linear solve, made when the first strain weights are known."""
        if self._made is None:
            weight, softened = self.energy.weight, self._softened
            self._made = self._system.linear(weight, team=self._team, softened=softened)
        return self._made

    def step(self) -> float:
        u, g, B, constraints = self.u, self._g, self.energy.forces, self.constraints
        if constraints:
            constraints.add_forces(u, B)
        self._linear.solve(B, g, self._team)
        g += u
        if constraints:
            constraints.project(g, u, self._solve)
        return float(largest_move(g, u)) / self._system.mesh.diagonal

    @property
    def softens(self) -> bool:
        """Whether the linear solve has the Laplacian with strain weights, by a factorisation of its own."""
        return self._softened and self._system.softens(self.energy.weight)

    def _solve(self, B: np.ndarray, X: np.ndarray) -> None:
        """Write directions M B_q to X_q, for B and X (q, n, 3)."""
        # V-cycles have work arrays of their own.
        if isinstance(self._linear, Factorised) and min(len(B), self._team.workers) > 1:
            self._team(lambda q: self._linear.solve(B[q], X[q]), len(B))
            return
        for q in range(len(B)):
            self._linear.solve(B[q], X[q], self._team)

    def end_step(self, short: bool) -> bool:
        return self._linear.end_step(short)

    def move(self, *, last: bool) -> None:
        before, accelerated = self._corrected + self._slack, self._advance(last)
        restores = accelerated or last
        fits = self.restore(exactly=last) if restores else True
        self.value = self._local_step(restored=restores)
        if accelerated and self._quasi_newton and not (self._corrected <= before and fits):
            self.rejected += 1
            self._quasi_newton.move(self.u, 0.5)
            fits = self.restore(exactly=last)
            self.value = self._local_step(restored=True)
            if not (self._corrected <= before and fits):
                self._quasi_newton.fall_back(self.u)
                if last:
                    self.restore(exactly=True)
                self.value = self._local_step()

    @property
    def _corrected(self) -> float:
        """The energy, corrected to first order for the errors of exact constraints."""
        return self.value + self.constraints.correction

    def _advance(self, last: bool) -> bool:
        """Replace u by the next iterate; return whether it is accelerated."""
        if not self._quasi_newton or (last and not self._accelerate_last):
            self.u[:] = self._g
            return False
        if self.constraints:
            self.constraints.add_moves(self.energy.forces)
        return self._quasi_newton.advance(self.u, self._g, self.energy.forces)

    def restore(self, *, exactly: bool = False) -> bool:
        """Project the iterate onto the exact constraints, along known directions; False if missed.

        Errors as of :meth:`sshade.solver.constraints.Constraints.restore`.
        """
        return self.constraints.restore(self.u, exactly=exactly)

    def aim_volume(self, goal: float) -> None:
        """Set the goal of the volume alone."""
        self.volume_goal = goal
        self.constraints.aim(goal)

    def project(self) -> None:
        """Project the iterate onto the exact constraints, along new directions."""
        if self.constraints:
            self.constraints.renew_directions(self.u, self._solve)
            self.restore(exactly=True)
