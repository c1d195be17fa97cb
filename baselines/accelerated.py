"""ARAP and Elastic at full resolution through this project's own accelerated solver.

These methods are not in the paper. libigl iterates plainly, and its number of iterations makes it slow. The
methods here reach the same minimum with quasi-Newton steps, which makes them a fairer peer of a method that
works on a proxy. A weight on the volume trades stretch for volume, from the unconstrained minimum to the
exact volume.

Proof: the papers' formulas in loops give the same plain iterates, and acceleration reaches their minimum
(tests/sshade/solver/test_local_global.py).
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

from sshade.core.progress import Progress, silent
from sshade.method.bound import Bound
from sshade.method.piece import Recipe
from sshade.problem.options import SOLVER, Elements, Options, checked, takes_options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.aim import initial_guess
from sshade.solver.local_global import bind_system, solve


def local_global(
    task: DeformationTask,
    *,
    energy: Elements = "spokes_and_rims",
    accelerate: bool = True,
    factorised: bool | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with our accelerated local/global solver.

    Parameters
    ----------
    task : DeformationTask
        Constraints on volume or area need a connected mesh.
    energy : {"spokes", "spokes_and_rims"}
        The elements of :class:`sshade.solver.system.System`.
    accelerate : bool
        Take quasi-Newton steps (L-BFGS, window 5), to the same minimum in a fraction of the steps.
    factorised : bool, optional
        See :func:`sshade.solver.local_global.bind_system`.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Of the energy and its iteration: :data:`sshade.problem.options.SOLVER`. The defaults are the
        published energy.

    Returns
    -------
    DeformationResult
        ``extra`` holds ``rotations``, ``residual``, the energies, ``rejected``, and the errors and states of
        volume and area, as of :class:`sshade.solver.solution.Solution`.

    Raises
    ------
    InputError
        On an unknown option or energy, or a value out of its range.
    FloatingPointError
        When an iterate is not finite.
    """
    resolved = Options(accelerate=accelerate, **checked(options, SOLVER, subject="the solver"))
    bound = bind_system(task, resolved, elements=energy, factorised=factorised)
    begin = perf_counter()
    start = initial_guess(task, resolved.start)
    solution = solve(bound.system, bound.aim, resolved, start=start, progress=progress)
    return solution.result({"precompute": bound.seconds, "solve": perf_counter() - begin})


@takes_options(SOLVER)
def accelerated_arap(
    task: DeformationTask,
    *,
    accelerate: bool = True,
    factorised: bool | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Minimise the spokes energy; see :func:`local_global`.

    If volume or area is constrained, or a component has no handles, components of the mesh are
    deformed separately.
    """
    return _solve(task, "spokes", accelerate=accelerate, factorised=factorised, progress=progress, **options)


@takes_options(SOLVER)
def accelerated_elastic(
    task: DeformationTask,
    *,
    accelerate: bool = True,
    factorised: bool | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Minimise the spokes-and-rims energy; see :func:`accelerated_arap`."""
    energy: Elements = "spokes_and_rims"
    return _solve(task, energy, accelerate=accelerate, factorised=factorised, progress=progress, **options)


def _solve(
    task: DeformationTask, energy: Elements, *, progress: Progress, **options: Any
) -> DeformationResult:
    def part(own: DeformationTask, report: Progress) -> DeformationResult:
        return local_global(own, energy=energy, progress=report, **options)

    free = len(task.mesh.components_without(task.handles.index))
    if not (options.get("volume") or options.get("area") or free):
        return part(task, progress)
    bound = Bound.of_task(task, Options(vertices=task.mesh.n), recipe=Recipe(part=part))
    return bound.solve(task.handles, guess=task.guess, progress=progress)
