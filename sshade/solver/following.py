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

from typing import Any

import numpy as np

from sshade.core.threads import ThreadTeam
from sshade.problem.options import ENERGY, complete
from sshade.solver.descent import Descent
from sshade.solver.local_global import LocalGlobal
from sshade.solver.quasi_newton import WINDOW_OF_DRAG
from sshade.solver.run import Aim, Solution, Stop, run

#: Least number of iterations of a solve whose targets have moved, if its cutoff allows.
LEAST = 2


class Following:
    """A :class:`LocalGlobal` solver, and the state that goes from solve to solve.

    Parameters
    ----------
    solver : LocalGlobal
        With a factorisation.
    positions : (n, 3) float64
    rotations : (n, 3, 3) float64
        First iterate, as of a solution. Hard handles are first put on their targets.
    aim : Aim
        With the targets there.
    workers : int
        Threads that share each iteration; no influence on the result.
    **energy
        See :data:`sshade.problem.options.ENERGY`.

    Raises
    ------
    InputError
        As :meth:`LocalGlobal.solve`.
    """

    def __init__(
        self,
        solver: LocalGlobal,
        positions: np.ndarray,
        rotations: np.ndarray,
        aim: Aim,
        *,
        workers: int = 1,
        **energy: Any,
    ) -> None:
        assert solver.matrix is not None and solver.factorised is not None
        self.solver, self._options, self._team = solver, complete(energy, ENERGY), ThreadTeam(workers)
        self._factorised = solver.factorised
        #: Columns of the matrix for the hard handles: how their moves pull on all vertices.
        self._to_handles = solver.matrix[:, solver.index[solver.hard]][solver.vertex]
        self._state = Descent(
            solver,
            self._options,
            solver.to_system(positions, aim.targets),
            team=self._team,
            window=WINDOW_OF_DRAG,
            single=True,
            accelerate_last=True,
        )
        self._state.aim(aim)
        self._state.energy.begin_with(rotations)
        self._state.begin(0.0)
        self._last_u = self._state.u.copy()
        self._targets = self._last_targets = aim.targets
        #: Whether the constraints have directions from an earlier solve.
        self._has_directions = False

    def solve(self, aim: Aim, *, tolerance: float = 1e-5, max_iterations: int = 1000) -> Solution:
        """Solve from where the last solve ended; parameters as of :meth:`LocalGlobal.solve`."""
        state, targets = self._state, aim.targets
        state.aim(aim)
        moved = not np.array_equal(targets, self._targets)
        if max_iterations > 0:
            self._predict(targets, aim.fraction)
        state.begin(tolerance)
        stop = Stop(tolerance, max_iterations, least_iterations=LEAST if moved else 1)
        return self.solver.solution(state, run(state, stop), targets, self._options)

    def _predict(self, targets: np.ndarray, fraction: np.ndarray | None) -> None:
        """Repeat a fraction of the last move of the shape, from -1 to 1, and go on to the targets."""
        solver, state, u = self.solver, self._state, self._state.u
        last, move = self._targets - self._last_targets, targets - self._targets
        square = float((last * last).sum())
        repeated = float(np.clip((move * last).sum() / square, -1.0, 1.0)) if square > 0 else 0.0
        step = u - self._last_u
        self._last_u[:] = u
        self._last_targets, self._targets = self._targets, targets
        if repeated:
            u += repeated * step
        springs, fixed = solver.springs, targets[solver.hard] - solver.mesh.origin
        stiffness = springs.stiffness if fraction is None else springs.stiffness * fraction[springs.handle]
        B = -(self._to_handles @ (fixed - u[solver.fixed]))
        B[springs.place] += stiffness[:, None] * (move - repeated * last)[springs.handle]
        self._factorised.solve(B, step, self._team)
        u += step
        u[solver.fixed] = fixed
        if self._has_directions:
            state.restore()
        else:
            state.project()
            self._has_directions = True
