"""As-rigid-as-possible deformation by our local/global solver with quasi-Newton steps.

A :class:`sshade.solver.system.System` binds the mesh and the handle vertices once (weights, elements,
factorisation). :func:`solve` solves it for any number of handle positions. All heavy steps run without the
GIL, so that solvers in several threads proceed at the same time.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes); I. Chao, U. Pinkall, P. Sanan,
P. Schroeder, "A simple geometric model for elastic deformations", 2010 (spokes and rims: the paper's
"Elastic").
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.core.threads import ThreadTeam
from sshade.problem.handle_checks import checked_target
from sshade.problem.options import Elements, Options, Stop
from sshade.problem.task import DeformationTask
from sshade.solver.aim import Aim, largest_pressures
from sshade.solver.attachment import Attachment
from sshade.solver.descent import Descent
from sshade.solver.quasi_newton import WINDOW
from sshade.solver.run import Run, run
from sshade.solver.solution import Solution
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


def solve(
    system: System,
    aim: Aim,
    options: Options,
    *,
    start: np.ndarray | None = None,
    rotations: np.ndarray | None = None,
    turned: np.ndarray | None = None,
    stop: Stop | None = None,
    window: int = WINDOW,
    workers: int = 1,
    softened: bool = False,
    progress: Progress = silent,
) -> Solution:
    """Iterate local and global steps until the residual is below a tolerance.

    The residual is the largest move of a vertex in one *plain* iteration over the rest shape's diagonal, also
    under acceleration; with multigrid and no exact steps, in one iteration with a V-cycle. Deterministic, and
    safe to call from several threads at once.

    Parameters
    ----------
    system : System
        Constraints on volume or area need a connected mesh.
    aim : Aim
    options : Options
        Weights of the constraints, softening, and whether to accelerate, which means quasi-Newton steps
        (L-BFGS, :mod:`sshade.solver.quasi_newton`).
    start : (n, 3) float64, optional
        First iterate; the rest shape if missing. Hard handles are first put on their targets.
    rotations : (n, 3, 3) float64, optional
        Rotations of an earlier solution near `start`. They make the first local step faster and do not
        change its result.
    turned : (n, 3, 3) float64, optional
        Rotations in the solver's order. The first iterate is then the global step from `start` for them.
    stop : Stop, optional
        By default the options' own.
    window : int
        Number of steps that L-BFGS stores; see :data:`sshade.solver.quasi_newton.WINDOW`.
    workers : int
        Threads that share each iteration, useful from 20,000 vertices on; no influence on the result.
    softened : bool
        Factorise the Laplacian with the strain weights of `start`, which must be near the minimum. The
        same energy then takes fewer iterations. Iteration stops at :data:`SOFTENED` times the tolerance,
        because steps along soft triangles are longer. No effect without softening or with multigrid.
    progress : Progress

    Raises
    ------
    InputError
        On targets of another shape or not finite.
    FloatingPointError
        When an iterate is not finite.
    """
    targets = checked_target(aim.targets, system.handles.index)
    stop = stop or options.stop
    u = system.to_system(system.mesh.V if start is None else start, targets)
    del start  # frees a large array if this is the last reference
    with ThreadTeam(workers) as team:
        state = Descent(
            system,
            options,
            u,
            team=team,
            window=window if options.accelerate else 0,
            single=system.multigrid,
            softened=softened,
        )
        state.aim(replace(aim, targets=targets))
        if rotations is not None:
            state.energy.begin_with(rotations)
        if turned is not None:
            state.begin_turned(turned)
        state.begin(stop.tolerance)
        if state.softens:
            stop = replace(stop, tolerance=SOFTENED * stop.tolerance)
        done = run(state, stop, progress=progress)
    return solution_of(system, state, done, targets)


def solution_of(system: System, state: Descent, done: Run, targets: np.ndarray) -> Solution:
    """Return the result of a finished run, in the mesh's order of vertices."""
    place = system.ordered.place
    return Solution(
        positions=system.from_system(state.u, targets),
        rotations=np.take(state.energy.R, place, axis=0).reshape(-1, 3, 3),
        iterations=done.iterations,
        converged=done.converged,
        residual=done.residual,
        residual_curve=done.residual_curve,
        energy=system.rest_energy + state.value,
        rejected=state.rejected,
        constraints=state.constraints.report(state.u, state.volume_goal),
    )


def project(
    system: System, positions: np.ndarray, options: Options, *, volume_goal: float = 1.0, workers: int = 1
) -> np.ndarray:
    """Project positions onto the exact constraints with the least rise of the energy.

    With multigrid the rise is nearly the least.

    Parameters
    ----------
    system : System
    positions : (n, 3) float64
        Near a shape that fulfils the constraints. Hard handles stay.
    options : Options
        Weights of volume and area; only inf has an effect.
    volume_goal : float
        See :class:`sshade.solver.aim.Aim`.
    workers : int
        Threads; no influence on the result.

    Returns
    -------
    (n, 3) float64
    """
    targets = positions[system.handles.index]
    alone = Options(volume=options.volume, area=options.area)
    with ThreadTeam(workers) as team:
        u = system.to_system(positions, targets)
        state = Descent(system, alone, u, team=team)
        state.aim_volume(volume_goal)
        state.project()
    return system.from_system(state.u, targets)


class BoundSystem(NamedTuple):
    """A system bound to a task, the aim for its handles and attached vertices, and the time that it took."""

    system: System
    aim: Aim
    seconds: float = 0.0


def bind_system(
    task: DeformationTask,
    options: Options,
    *,
    volume_goal: float = 1.0,
    elements: Elements = "spokes_and_rims",
    factorised: bool | None = None,
    exact_steps: int = EXACT_STEPS,
) -> BoundSystem:
    """Bind a system to the mesh and the handles of a task.

    Parameters
    ----------
    task : DeformationTask
        Constraints on volume or area need a connected mesh.
    options : Options
    volume_goal : float
        Of the aim.
    elements : {"spokes", "spokes_and_rims"}
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
    system = System(
        task.mesh,
        attachment.vertex[pulled],
        options,
        elements=elements,
        stiffness=stiffness,
        multigrid=not factorised,
        exact_steps=exact_steps,
    )
    aim = Aim(
        targets,
        task.handles.prescribed_rotations,
        volume_goal=volume_goal,
        pressure=largest_pressures(task.mesh, task.handles, options),
    )
    return BoundSystem(system, aim, perf_counter() - begin)
