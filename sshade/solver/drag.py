"""Solves of one system in a row, as targets move: a drag.

A solve begins at the state in which the last one ended: positions, rotations, strain weights and multipliers
of constraints. First it repeats the last move of the shape, as far as this brings the targets nearer; if the
targets stop or turn, so does the shape. The rest of the targets' move deforms the shape by the quadratic
energy of the Laplacian, without a local step in between: rotations fitted to handles that move alone would
turn with the handles. At least two quasi-Newton steps follow. They begin with the pairs of earlier solves,
because the curvature of the energy hardly changes from one solve to the next, and the second step uses the
pair of the first. A drag lags mostly in slow modes, which plain steps hardly move. More pairs know more of
these modes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.problem.options import Options, Stop
from sshade.solver.aim import Aim
from sshade.solver.descent import Descent
from sshade.solver.local_global import solution_of
from sshade.solver.quasi_newton import WINDOW_OF_DRAG
from sshade.solver.run import run
from sshade.solver.solution import Solution
from sshade.solver.system import System

#: Least number of iterations of a solve whose targets have moved, if its cutoff allows.
LEAST = 2


class Drag:
    """A system, and the state that goes from solve to solve.

    Parameters
    ----------
    system : System
        With a factorisation.
    positions : (n, 3) float64
    rotations : (n, 3, 3) float64
        First iterate, as of a solution. Hard handles are first put on their targets.
    aim : Aim
        With the targets there.
    options : Options
        Weights of the constraints, and softening.
    workers : int
        Threads that share each iteration; no influence on the result.
    """

    def __init__(
        self,
        system: System,
        positions: np.ndarray,
        rotations: np.ndarray,
        aim: Aim,
        options: Options,
        *,
        workers: int = 1,
    ) -> None:
        assert system.factorised is not None
        self._system = system
        self._options = options
        self._team = ThreadTeam(workers)
        self._factorised = system.factorised
        handles = system.handles
        #: Columns of the matrix for the hard handles: how their moves pull on all vertices.
        self._to_handles = system.matrix[:, handles.index[handles.hard]][system.ordered.vertex]
        self._state = Descent(
            system,
            options,
            system.to_system(positions, aim.targets),
            team=self._team,
            window=WINDOW_OF_DRAG,
            single=True,
            accelerate_last=True,
        )
        self._state.constraints.early_steps = 0
        self._state.aim(aim)
        self._state.energy.begin_with(rotations)
        self._state.begin(0.0)
        self._last_u = self._state.u.copy()
        self._targets = self._last_targets = aim.targets
        #: Whether the constraints have directions from an earlier solve.
        self._has_directions = False

    def solve(self, aim: Aim, stop: Stop) -> Solution:
        """Solve from where the last solve ended."""
        state, targets = self._state, aim.targets
        state.aim(aim)
        moved = not np.array_equal(targets, self._targets)
        if stop.max_iterations > 0:
            self._predict(targets, aim.fraction)
        state.begin(stop.tolerance)
        done = run(state, replace(stop, least_iterations=LEAST if moved else 1))
        return solution_of(self._system, state, done, targets)

    def _predict(self, targets: np.ndarray, fraction: np.ndarray | None) -> None:
        """Repeat a fraction of the last move of the shape, from -1 to 1, and go on to the targets."""
        handles, state, u = self._system.handles, self._state, self._state.u
        last, move = self._targets - self._last_targets, targets - self._targets
        square = float((last * last).sum())
        repeated = float(np.clip((move * last).sum() / square, -1.0, 1.0)) if square > 0 else 0.0
        step = u - self._last_u
        self._last_u[:] = u
        self._last_targets, self._targets = self._targets, targets
        if repeated:
            u += repeated * step
        fixed, stiffness = targets[handles.hard] - self._system.mesh.origin, handles.stiffness
        if fraction is not None:
            stiffness = stiffness * fraction[handles.soft]
        B = -(self._to_handles @ (fixed - u[handles.fixed]))
        B[handles.pulled] += stiffness[:, None] * (move - repeated * last)[handles.soft]
        self._factorised.solve(B, step, self._team)
        u += step
        u[handles.fixed] = fixed
        if self._has_directions:
            state.restore()
        else:
            state.project()
            self._has_directions = True
