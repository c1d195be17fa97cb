"""ARAP and Elastic at full resolution through this project's own accelerated solver.

These methods are not in the paper. libigl iterates plainly, and its number of iterations makes it slow. The
methods here reach the same minimum with quasi-Newton steps, which makes them a fairer peer of a method that
works on a proxy. A weight on the volume trades stretch for volume, from the unconstrained minimum to the
exact volume.
"""

from __future__ import annotations

from typing import Any

from sshade.core.progress import Progress, silent
from sshade.method.pieces import Pieces, both
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
    if not (options.get("volume") or options.get("area") or task.carry_unconstrained):
        return local_global(task, energy=energy, progress=progress, **options)
    pieces = Pieces(task, Options(vertices=task.mesh.n), progress)
    for piece in pieces.in_order():
        with piece.named():
            result = local_global(piece.task, energy=energy, progress=piece.progress, **options)
            if (again := pieces.again(piece, result)) is not None:
                further = local_global(again.task, energy=energy, progress=again.progress, **options)
                result = both(result, further)
        pieces.put(piece, result)
    return pieces.together()
