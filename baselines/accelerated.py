"""ARAP and Elastic at full resolution through this project's own accelerated solver.

Not one of the paper's methods: libigl iterates plainly, and its iteration count
is what makes it slow. These two reach the same minimum with quasi-Newton
steps, a fairer peer of a method that works on a proxy. With a weight on the
volume they trade it for stretch, from the free minimum to the exact volume.
"""

from __future__ import annotations

from sshade.solver.coarse import Start
from sshade.solver.factor import Engine
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask, Progress, silent


def accelerated_arap(
    task: DeformationTask,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    accelerate: bool = True,
    volume: float = 0.0,
    area: float = 0.0,
    start: Start = "rest",
    engine: Engine = "auto",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Minimise the spokes energy; see :func:`sshade.solver.local_global.local_global`."""
    return local_global(
        task,
        energy="spokes",
        tolerance=tolerance,
        max_iterations=max_iterations,
        accelerate=accelerate,
        volume=volume,
        area=area,
        start=start,
        engine=engine,
        seed=seed,
        progress=progress,
    )


def accelerated_elastic(
    task: DeformationTask,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    accelerate: bool = True,
    volume: float = 0.0,
    area: float = 0.0,
    start: Start = "rest",
    engine: Engine = "auto",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Minimise the spokes-and-rims energy; see :func:`sshade.solver.local_global.local_global`."""
    return local_global(
        task,
        energy="spokes_and_rims",
        tolerance=tolerance,
        max_iterations=max_iterations,
        accelerate=accelerate,
        volume=volume,
        area=area,
        start=start,
        engine=engine,
        seed=seed,
        progress=progress,
    )
