"""ARAP and Elastic at full resolution through this project's own accelerated solver.

These methods are not in the paper. libigl iterates plainly, and its number of iterations makes it slow. The
methods here reach the same minimum with quasi-Newton steps, which makes them a fairer peer of a method that
works on a proxy. A weight on the volume trades stretch for volume, from the unconstrained minimum to the
exact volume.
"""

from __future__ import annotations

from typing import Any

from sshade.core.progress import Progress, silent
from sshade.method.pieces import in_pieces
from sshade.problem.options import SOLVER, Energy, Options, takes_options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.local_global import local_global


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
    """Minimise the spokes energy; see :func:`sshade.solver.local_global.local_global`.

    If volume or area is constrained, or components without handles are carried, components of the mesh are
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
    energy: Energy = "spokes_and_rims"
    return _solve(task, energy, accelerate=accelerate, factorised=factorised, progress=progress, **options)


def _solve(task: DeformationTask, energy: Energy, *, progress: Progress, **options: Any) -> DeformationResult:
    def deform(task: DeformationTask, *, progress: Progress, **of_proxy: Any) -> DeformationResult:
        return local_global(task, energy=energy, progress=progress, **options)

    if options.get("volume") or options.get("area") or task.carry_unconstrained:
        return in_pieces(task, deform, Options(vertices=task.mesh.n), progress=progress)
    return deform(task, progress=progress)
