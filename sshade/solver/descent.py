"""Local/global iterations: the energy of a solve, its local and global steps, and quasi-Newton steps."""

from __future__ import annotations

import math

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.mesh.rotations import fit_rotations, quaternions
from sshade.problem.options import Options
from sshade.solver.aim import Aim
from sshade.solver.constraints import Constraints
from sshade.solver.factorisation import Factorised, Linear
from sshade.solver.quasi_newton import QuasiNewton
from sshade.solver.run import largest_move
from sshade.solver.system import System
from sshade.solver.terms import Arap


class Energy:
    """The energy of a bound system under given targets: the sum of its terms.

    Parameters
    ----------
    system : System
    options : Options
        `stiffness`, `strain` and `strain_limit`; see :mod:`sshade.solver.terms.arap`.
    team : ThreadTeam

    Attributes
    ----------
    terms : list of Term
        With the state of this solve; the first one overwrites covariances and forces.
    R : (n, 9) float64
        Rotation matrices of the last local step, row by row, in the solver's order.
    forces : (n, 3) float64
        Minus half of the gradient at the last local step, divided by
        :attr:`sshade.solver.system.System.corners`. Global steps may overwrite it.
    """

    def __init__(self, system: System, options: Options, *, team: ThreadTeam) -> None:
        n = system.mesh.n
        self._system = system
        self._ordered = system.ordered
        self._team = team
        self.terms = [term.begun(options) for term in system.terms]
        self._Q = np.tile([1.0, 0, 0, 0], (n, 1))
        self.R = np.empty((n, 9))
        self.forces = np.empty((n, 3))

    @property
    def weight(self) -> np.ndarray | None:
        """(m,) strain weights of the triangles at the last local step; None for the quadratic energy."""
        return next(term.weight for term in self.terms if isinstance(term, Arap))

    def aim(self, aim: Aim) -> None:
        """Set the targets of handles and the motions to follow."""
        for term in self.terms:
            term.aim(aim)
        vertex, rotations = aim.prescribed or (np.empty(0, dtype=np.int64), np.empty((0, 3, 3)))
        place = self._ordered.place[vertex]
        order = np.argsort(place)
        self._prescribed = place[order], np.array(rotations, dtype=np.float64)[order]

    def begin_with(self, rotations: np.ndarray) -> None:
        """Begin the search for rotations at the rotations (n, 3, 3) of the mesh's vertices."""
        self._Q[:] = quaternions(rotations)[0][self._ordered.vertex]

    def local_step(self, u: np.ndarray) -> float:
        """Fit the rotations to positions u (n, 3), and compute the forces there.

        Returns
        -------
        float
            The energy minus :attr:`sshade.solver.system.System.rest_energy`.
        """

        def fit(number: int) -> float:
            energy = 0.0
            for term in self.terms:
                energy += term.local(number, u, self.R)
            energy -= 2.0 * self._rotate(number)
            for term in self.terms:
                term.turn(number, self.R)
            return energy

        # The sum of the fits is the quadratic energy without a constant, the rest energy. With strain weights
        # the energy is known only after the forces.
        quadratic = sum(self._team(fit, len(self._ordered.ranges)))
        total = self._sum_forces(u)
        return quadratic if self.weight is None else total - self._system.rest_energy

    def turn(self, u: np.ndarray, rotations: np.ndarray) -> None:
        """Compute the forces at positions u (n, 3) for given rotations (n, 3, 3) in the solver's order."""

        def turn(number: int) -> None:
            for term in self.terms:
                term.local(number, u, self.R)
            _, first, end = self._ordered.ranges[number]
            self.R[first:end] = rotations[first:end].reshape(-1, 9)
            for term in self.terms:
                term.turn(number, self.R)

        self._team(turn, len(self._ordered.ranges))
        self._sum_forces(u)

    def _sum_forces(self, u: np.ndarray) -> float:
        """Compute the forces at positions u for the present rotations, and return the energy."""

        def force(number: int) -> float:
            energy = 0.0
            for term in self.terms:
                energy += term.forces(number, u, self.R, self.forces)
            return energy

        return sum(self._team(force, len(self._ordered.ranges)))

    def _rotate(self, number: int) -> float:
        """Replace covariances S in R by rotations, fitted or prescribed; return ``sum tr(R S)``."""
        _, first, end = self._ordered.ranges[number]
        place, rotations = self._prescribed
        own = slice(*np.searchsorted(place, (first, end)))
        place, rotations = place[own], rotations[own]
        S = self.R[place].reshape(-1, 3, 3)
        total = fit_rotations(self.R[first:end], self._Q[first:end])
        if len(place):
            fitted = self.R[place].reshape(-1, 3, 3)
            total += float(np.einsum("iab,iba->", rotations - fitted, S))
            self.R[place] = rotations.reshape(-1, 9)
        return total


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
    value : float
        Energy at the present iterate, minus the rest energy.
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
        self._system = system
        self.energy = Energy(system, options, team=team)
        self._team = team
        self.constraints = Constraints(
            system.surface,
            options.volume,
            options.area,
            corners=system.corners,
            team=team,
            single=system.multigrid and not system.exact_steps,
        )
        self.u = u
        self._g = np.empty_like(u)
        self._accelerate_last = accelerate_last
        self._softened = softened
        self._made: Linear | None = None
        self._quasi_newton: QuasiNewton | None = None
        if window:
            unit = system.mesh.diagonal
            self._quasi_newton = QuasiNewton(len(u), window, unit=unit, single=single, team=team)
        self._slack = ENERGY_ROUNDING * abs(system.rest_energy)

    def aim(self, aim: Aim) -> None:
        """Set what the next solve aims at."""
        self.energy.aim(aim)
        self.aim_volume(aim.volume_goal, aim.pressure)

    def begin(self, tolerance: float) -> None:
        """Fit the rotations to the present iterate, where a solve with a tolerance begins."""
        self.constraints.begin(tolerance)
        if self._quasi_newton:
            self._quasi_newton.cut()
        self.value = self._local_step()
        self.rejected = 0

    def begin_turned(self, rotations: np.ndarray) -> None:
        """Begin at the global step from the present iterate for rotations (n, 3, 3) in the solver's order."""
        self.energy.turn(self.u, rotations)
        self._linear.solve(self.energy.forces, self._g, self._team)
        self.u += self._g

    def _local_step(self, *, restored: bool = False) -> float:
        """Fit the rotations; return the energy. If `restored`, :meth:`restore` has just been called."""
        return self.energy.local_step(self.u) + self.constraints.penalty(self.u, restored=restored)

    @property
    def _linear(self) -> Linear:
        """The linear solve, made when the first strain weights are known."""
        if self._made is None:
            self._made = self._system.linear(self.energy.terms, team=self._team, softened=self.softens)
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
        return self._softened and not self._system.multigrid and self.energy.weight is not None

    def _solve(self, B: np.ndarray, X: np.ndarray) -> None:
        """Write directions M B_q to X_q, for B and X (q, n, 3)."""
        # V-cycles have work arrays of their own.
        if isinstance(self._linear, Factorised) and min(len(B), self._team.workers) > 1:
            self._team(lambda q: self._linear.solve(B[q], X[q]), len(B))
            return
        for q in range(len(B)):
            self._linear.solve(B[q], X[q], self._team)

    def end_step(self, short: bool) -> bool:
        return self._linear.end_step(short and not self.constraints.early)

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

    def aim_volume(self, goal: float, pressure: tuple[float, float] = (math.inf, math.inf)) -> None:
        """Set the goal of the volume alone, and the largest pressures of exact constraints."""
        self.volume_goal = goal
        self.constraints.aim(goal, pressure)

    def project(self) -> None:
        """Project the iterate onto the exact constraints, along new directions."""
        if self.constraints:
            self.constraints.renew_directions(self.u, self._solve)
            self.restore(exactly=True)
