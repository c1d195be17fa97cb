"""ARAP and Elastic at full resolution through this project's own accelerated solver.

Not one of the paper's methods: libigl iterates plainly, and its iteration count
is what makes it slow. These two reach the same minimum with quasi-Newton
steps, a fairer peer of a method that works on a proxy. With a weight on the
volume they trade it for stretch, from the free minimum to the exact volume.
"""

from __future__ import annotations

from typing import Any

from sshade.options import SOLVER, takes_options
from sshade.progress import Progress, silent
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask


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
    """Minimise the spokes energy; see :func:`sshade.solver.local_global.local_global`."""
    return local_global(
        task, energy="spokes", accelerate=accelerate, factorised=factorised, progress=progress, **options
    )


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
    """Minimise the spokes-and-rims energy; see :func:`sshade.solver.local_global.local_global`."""
    return local_global(
        task,
        energy="spokes_and_rims",
        accelerate=accelerate,
        factorised=factorised,
        progress=progress,
        **options,
    )
