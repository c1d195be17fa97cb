"""As-rigid-as-possible deformation by our local/global solver with quasi-Newton steps.

:class:`LocalGlobal` binds the mesh and the handle vertices once (weights, elements, factorisation). It solves
for any number of handle positions. All heavy steps run without the GIL, so that solvers in several threads
proceed at the same time.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes); I. Chao, U. Pinkall, P. Sanan,
P. Schroeder, "A simple geometric model for elastic deformations", 2010 (spokes and rims: the paper's
"Elastic").
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.core.threads import Pending, ThreadTeam
from sshade.problem.handle_checks import checked_target
from sshade.problem.options import ENERGY, MATRIX, Energy, Options, complete
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.attachment import Attachment
from sshade.solver.descent import Descent
from sshade.solver.quasi_newton import WINDOW
from sshade.solver.run import Aim, Run, Solution, Stop, initial_guess, run
from sshade.solver.system import System

#: Largest number of vertices for which a task is factorised by default. V-cycles take as long at
#: 170,000 vertices, in a sixth of the memory, and half as long at 680,000.
FACTORISED = 100_000
#: Nearly exact steps of a solve without a factorisation. They decide which minimum is found:
#: with 5, some bodies with handles moved far ended in higher minima.
EXACT_STEPS = 20
#: Tolerance of a solve with a softened Laplacian, as a multiple of the tolerance asked for. Such solves ended
#: at a lower energy than solves with the Laplacian of the rest shape in 12 of 13 cases.
SOFTENED = 3.0


class LocalGlobal(System):
    """Minimises an as-rigid-as-possible energy under prescribed vertex positions.

    Parameters, attributes and errors as of :class:`sshade.solver.system.System`. Constraints on volume or
    area need a connected mesh.
    """

    def solve(
        self,
        aim: Aim,
        *,
        start: np.ndarray | None = None,
        rotations: np.ndarray | None = None,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
        accelerate: bool = True,
        window: int = WINDOW,
        workers: int = 1,
        softened: bool = False,
        progress: Progress = silent,
        **energy: Any,
    ) -> Solution:
        """Iterate local and global steps until the residual is below a tolerance.

        The residual is the largest move of a vertex in one *plain* iteration over the rest shape's diagonal,
        also under acceleration; with multigrid and no exact steps, in one iteration with a V-cycle.
        Deterministic, and safe to call from several threads at once.

        Parameters
        ----------
        aim : Aim
        start : (n, 3) float64, optional
            First iterate; the rest shape if missing. Hard handles are first put on their targets.
        rotations : (n, 3, 3) float64, optional
            Rotations of an earlier solution near `start`. They make the first local step faster and do not
            change its result.
        tolerance : float
            Residual below which iteration stops. 0 never stops early.
        max_iterations : int
        accelerate : bool
            Take quasi-Newton steps, L-BFGS; see :mod:`sshade.solver.quasi_newton`.
        window : int
            Number of steps that L-BFGS stores; see :data:`sshade.solver.quasi_newton.WINDOW`.
        workers : int
            Threads that share each iteration, useful from 20,000 vertices on; no influence on the result.
        softened : bool
            Factorise the Laplacian with the strain weights of `start`, which must be near the minimum. The
            same energy then takes fewer iterations. Iteration stops at :data:`SOFTENED` times the tolerance,
            because steps along soft triangles are longer. No effect without softening or with multigrid.
        progress : Progress
        **energy
            Weights of the constraints, and softening: the options :data:`sshade.problem.options.ENERGY` of
            :class:`sshade.problem.options.Options`. By default neither.

        Returns
        -------
        Solution

        Raises
        ------
        InputError
            On targets of another shape or not finite, an unknown option or a value out of its range.
        FloatingPointError
            When an iterate is not finite.
        """
        options = complete(energy, ENERGY)
        targets = checked_target(aim.targets, self.index)
        u = self.to_system(self.mesh.V if start is None else start, targets)
        del start  # frees a large array if this is the last reference
        with ThreadTeam(workers) as team:
            window = window if accelerate else 0
            kinds = {"single": self.multigrid, "softened": softened}
            state = Descent(self, options, u, team=team, window=window, **kinds)
            state.aim(replace(aim, targets=targets))
            if rotations is not None:
                state.energy.begin_with(rotations)
            state.begin(tolerance)
            if state.softens:
                tolerance *= SOFTENED
            done = run(state, Stop(tolerance, max_iterations), progress=progress)
        return self.solution(state, done, targets, options)

    def solution(self, state: Descent, done: Run, targets: np.ndarray, options: Options) -> Solution:
        """Return the result of a finished run, in the mesh's order of vertices."""
        positions = self.from_system(state.u, targets)
        return Solution(
            positions=positions,
            rotations=np.take(state.energy.R, self.place, axis=0).reshape(-1, 3, 3),
            iterations=done.iterations,
            residual=done.residual,
            residual_curve=done.residual_curve,
            energy=self.rest_energy + state.value,
            converged=done.converged,
            rejected=state.rejected,
            **self.surface.report(state.u, options.volume, options.area, volume_goal=state.volume_goal),
        )

    def project(
        self,
        positions: np.ndarray,
        *,
        volume: float = 0.0,
        area: float = 0.0,
        volume_goal: float = 1.0,
        workers: int = 1,
    ) -> np.ndarray:
        """Project positions onto the exact constraints with the least rise of the energy.

        With multigrid the rise is nearly the least.

        Parameters
        ----------
        positions : (n, 3) float64
            Near a shape that fulfils the constraints. Hard handles stay.
        volume, area : float
            Weights; only inf has an effect.
        volume_goal : float
            See :class:`sshade.solver.run.Aim`.
        workers : int
            Threads; no influence on the result.

        Returns
        -------
        (n, 3) float64
        """
        targets = positions[self.index]
        with ThreadTeam(workers) as team:
            u = self.to_system(positions, targets)
            state = Descent(self, Options(volume=volume, area=area), u, team=team)
            state.aim_volume(volume_goal)
            state.project()
        return self.from_system(state.u, targets)

    def to_system(self, positions: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n, 3) in the solver's order, relative to the mesh's origin, with hard handles on their targets."""
        u = positions[self.vertex] - self.mesh.origin
        u[self.fixed] = targets[self.hard] - self.mesh.origin
        return u

    def from_system(self, u: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n, 3) in the mesh's order, with hard handles exactly on their targets."""
        positions = np.take(u, self.place, axis=0) + self.mesh.origin
        hard = self.hard
        positions[self.index[hard]] = targets[hard]
        return positions


class Prepared(NamedTuple):
    """A solver bound to a task, the aim for its handles and attached vertices, and the time that it took."""

    solver: LocalGlobal
    aim: Aim
    seconds: float = 0.0


def prepare(
    task: DeformationTask,
    options: Options,
    *,
    volume_goal: float = 1.0,
    energy: Energy = "spokes_and_rims",
    factorised: bool | None = None,
    exact_steps: int = EXACT_STEPS,
) -> Prepared:
    """Set up a solver for the mesh and the handles of a task.

    Parameters
    ----------
    task : DeformationTask
        Constraints on volume or area need a connected mesh.
    options : Options
    volume_goal : float
        Of the aim.
    energy : {"spokes", "spokes_and_rims"}
        See :class:`sshade.solver.system.System`.
    factorised : bool, optional
        Factorise the Laplacian; otherwise use V-cycles after `exact_steps` nearly exact steps. V-cycles need
        memory in proportion to the mesh, and reach the same minimum up to the tolerance. The default
        factorises meshes of up to :data:`FACTORISED` vertices, and all meshes with bending.
    exact_steps : int
        See :class:`sshade.solver.system.System`.
    """
    begin = perf_counter()
    if factorised is None:
        factorised = task.mesh.n <= FACTORISED or options.bending > 0
    attachment = Attachment(task.mesh, task.handles, options.attachment)
    targets, fraction = attachment.pulls(task.handles.target, task.handles.rotation)
    # The targets stay, so vertices without a pull are left out of the system.
    pulled = fraction > 0
    targets, stiffness = targets[pulled], (attachment.stiffness * fraction)[pulled]
    majority = task.handles.majority
    matrix = options.subset(MATRIX)
    if majority is None or not majority.certainty:
        matrix["inertia"] = 0.0
    solver = LocalGlobal(
        task.mesh,
        attachment.vertex[pulled],
        energy=energy,
        stiffness=stiffness,
        multigrid=not factorised,
        exact_steps=exact_steps,
        **matrix,
    )
    aim = Aim(targets, task.handles.prescribed_rotations, volume_goal=volume_goal, majority=majority)
    return Prepared(solver, aim, perf_counter() - begin)


def solve_task(
    task: DeformationTask,
    *,
    prepared: Pending[Prepared],
    options: Options,
    workers: int,
    tolerance: float,
    softened: bool = False,
    progress: Progress = silent,
) -> DeformationResult:
    """Solve a task from its guess or its start, with the solver that was set up for it.

    Parameters
    ----------
    task : DeformationTask
    prepared : Pending of Prepared
        Result of :func:`prepare` for the same mesh, handles and options, now or later.
    options : Options
        Of the energy and its iteration, but for the tolerance.
    workers : int
        Threads that share each iteration; no influence on the result.
    tolerance : float
    softened : bool
        See :meth:`LocalGlobal.solve`.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds ``rotations``, ``residual``, the energies, ``rejected``, and the errors and states of
        volume and area, as of :class:`sshade.solver.run.Solution`.

    Raises
    ------
    FloatingPointError
        When an iterate is not finite.
    """
    ready, begin = prepared.result(), perf_counter()
    solution = ready.solver.solve(
        ready.aim,
        start=initial_guess(task, options.start),
        accelerate=options.accelerate,
        workers=workers,
        softened=softened,
        progress=progress,
        tolerance=tolerance,
        max_iterations=options.max_iterations,
        **options.subset(ENERGY),
    )
    return solution.result({"precompute": ready.seconds, "solve": perf_counter() - begin})
