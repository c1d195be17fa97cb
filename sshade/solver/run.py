"""Where an iteration begins, its loop until the residual is below a tolerance, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.kernels import kernel
from sshade.core.progress import Progress, silent
from sshade.mesh.rigid import rigid_motion
from sshade.problem.majority import MajorityMotion
from sshade.problem.options import Start
from sshade.problem.task import DeformationResult, DeformationTask

#: Distance of the auxiliary points beside a handle with a prescribed rotation, as a fraction of the diagonal.
BESIDE = 1e-3


def initial_guess(task: DeformationTask, start: Start) -> np.ndarray:
    """Return the rest shape, or its best rigid motion to the handles, with hard handles on their targets.

    Parameters
    ----------
    task : DeformationTask
    start : {"rest", "rigid"}
        ``rigid`` applies the best rotation and translation of the handles to their targets, weighted by
        stiffness if all handles are soft. Prescribed rotations decide if the positions leave the rotation
        undetermined. If the task has a guess, it takes the place of both.

    Returns
    -------
    (n, 3) float64

    Raises
    ------
    InputError
        On an unknown start.
    """
    V, handles = task.mesh.V, task.handles
    if start not in ("rest", "rigid"):
        raise InputError(f"unknown start {start!r}; use 'rest' or 'rigid'")
    if task.guess is not None:
        U = np.array(task.guess, dtype=np.float64)
    elif start == "rest":
        U = V.copy()
    else:
        # The weighted fit of soft handles is the minimum of the energy over all rigid motions.
        source, target = V[handles.index], handles.target
        weights = None if handles.hard.any() else handles.stiffness
        if prescribed := handles.prescribed_rotations:
            # Three auxiliary points beside each such handle, near enough not to disturb the fit of positions.
            vertex, turns = prescribed
            number = np.flatnonzero(np.isin(handles.index, vertex))
            beside = BESIDE * task.mesh.diagonal * np.eye(3)
            source = np.concatenate([source, (V[vertex, None] + beside).reshape(-1, 3)])
            turned = target[number, None] + beside @ turns.transpose(0, 2, 1)
            target = np.concatenate([target, turned.reshape(-1, 3)])
            if weights is not None:
                weights = np.concatenate([weights, np.repeat(weights[number], 3)])
        R, t = rigid_motion(source, target, weights=weights)
        U = V @ R.T + t
    U[handles.index[handles.hard]] = handles.target[handles.hard]
    return U


#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10


class IterationState(Protocol):
    """The unknowns u of an iteration, and the steps that change them."""

    def step(self) -> float:
        """Compute the plain iterate g(u) from the present iterate u.

        Returns
        -------
        float
            The residual: the largest move ``max_i |g(u)_i - u_i|``, divided by the rest shape's bounding-box
            diagonal; or a larger move of another unknown.
        """

    def end_step(self, short: bool) -> bool:
        """Return whether the last step proves convergence.

        Parameters
        ----------
        short : bool
            The residual of the step is below the tolerance.
        """

    def move(self, *, last: bool) -> None:
        """Replace u by g(u) or by an accelerated iterate.

        Parameters
        ----------
        last : bool
            No step follows in this run. The iterate is then g(u), unless another run continues from it.
        """


class Stop(NamedTuple):
    """When an iteration stops.

    Attributes
    ----------
    tolerance : float
        Residual below which it stops; 0 never stops early.
    max_iterations : int
    least_iterations : int
        Convergence counts from this iteration on.
    """

    tolerance: float = 1e-5
    max_iterations: int = 1000
    least_iterations: int = 0


class Run(NamedTuple):
    """How an iteration went: the residual of each step, and whether the last one is below the tolerance."""

    residual_curve: np.ndarray
    converged: bool

    @property
    def iterations(self) -> int:
        return len(self.residual_curve)

    @property
    def residual(self) -> float:
        """The last residual; infinite without an iteration."""
        return float(self.residual_curve[-1]) if self.iterations else inf


def run(
    state: IterationState, stop: Stop, *, progress: Progress = silent, report_every: int = REPORT_EVERY
) -> Run:
    """Iterate until a plain step moves no vertex by more than a tolerance.

    Parameters
    ----------
    state : IterationState
        Changed in place.
    stop : Stop
    progress : Progress
    report_every : int
        Iterations between two calls of `progress`.

    Raises
    ------
    InputError
        When the tolerance or the number of iterations is negative, or no number.
    FloatingPointError
        When a residual is not finite.
    """
    tolerance, most = stop.tolerance, stop.max_iterations
    if not (tolerance >= 0 and most >= 0 and most % 1 == 0):
        raise InputError(
            "tolerance must be at least 0 and max_iterations a whole number of at least 0, not "
            f"{tolerance} and {most}"
        )
    residuals: list[float] = []
    residual, converged, last = inf, False, stop.max_iterations == 0
    progress("iterations", 0, stop.max_iterations)
    while not last:
        residual = state.step()
        residuals.append(residual)
        iterations = len(residuals)
        if not np.isfinite(residual):
            raise FloatingPointError(
                f"the positions are not finite after {counted(iterations, 'iteration', 'iterations')}"
            )
        converged = state.end_step(residual < stop.tolerance) and iterations >= stop.least_iterations
        last = converged or iterations == stop.max_iterations
        state.move(last=last)
        if iterations % report_every == 0:
            progress("iterations", iterations, stop.max_iterations, f"residual {residual:.1e}")
    progress("iterations", len(residuals), len(residuals), f"residual {residual:.1e}")
    return Run(np.array(residuals), converged)


@kernel
def largest_move(A, B):
    """Return ``max_i |A_i - B_i|`` of two (n, 3) arrays; NaN if one has NaN."""
    largest = 0.0
    for i in range(len(A)):
        x, y, z = A[i, 0] - B[i, 0], A[i, 1] - B[i, 1], A[i, 2] - B[i, 2]
        square = x * x + y * y + z * z
        if not square <= largest:  # also true for NaN, which then stays
            largest = square
            if np.isnan(square):
                break
    return np.sqrt(largest)


@dataclass(frozen=True)
class Aim:
    """What a solve aims at; a solver may be given one aim after another.

    Attributes
    ----------
    targets : (k, 3) float64
        Positions of the handle vertices, in the order of the solver's `index`.
    prescribed : ((j,) int, (j, 3, 3) float64), optional
        Vertices, each once, and their prescribed rotations, which the local step does not fit. See
        :attr:`sshade.Handles.prescribed_rotations`.
    fraction : (k,) float64, optional
        Fraction of the stiffness of each soft handle, in [0, 1]; 1 if missing. It may vary from solve to
        solve with one factorisation.
    volume_goal : float
        Volume to reach if the volume is constrained, as a multiple of the volume at rest; positive.
    majority : MajorityMotion, optional
        Motion towards which inertia pulls; without one, inertia is off.
    """

    targets: np.ndarray
    prescribed: tuple[np.ndarray, np.ndarray] | None = None
    fraction: np.ndarray | None = None
    volume_goal: float = 1.0
    majority: MajorityMotion | None = None


class Solution(NamedTuple):
    """A deformed shape and how the iteration went.

    Attributes
    ----------
    positions : (n, 3) float64
        Hard handles are on their targets exactly.
    rotations : (n, 3, 3) float64
        Rotations of the local step at `positions`, from rest edges to deformed ones.
    iterations : int
        Global steps.
    residual : float
        Largest move of a vertex in the last plain iteration, as a fraction of the bounding-box diagonal.
    residual_curve : (iterations,) float64
        Residual of each iteration.
    energy : float
        Energy after the local step at `positions`, with the penalties of weighted constraints and the pulls
        of soft handles; unit length^2.
    converged : bool
    rejected : int
        Accelerated iterates that were given up because the energy rose.
    volume_error, area_error : float
    volume_constraint, area_constraint : str
        See :meth:`sshade.solver.constraints.ConstrainedSurface.report`.
    """

    positions: np.ndarray
    rotations: np.ndarray
    iterations: int
    residual: float
    residual_curve: np.ndarray
    energy: float
    converged: bool
    rejected: int
    volume_error: float
    area_error: float
    volume_constraint: str
    area_constraint: str

    def result(self, seconds: Mapping[str, float] | None = None) -> DeformationResult:
        """Return the result of a task, with the seconds of its stages."""
        return DeformationResult(self.positions, self.iterations, self.converged, seconds or {}, self.facts())

    def facts(self) -> dict[str, Any]:
        """Return the fields for the `extra` of a result."""
        elsewhere = ("positions", "iterations", "converged")
        return {name: value for name, value in self._asdict().items() if name not in elsewhere}
