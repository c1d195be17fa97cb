"""ARAP and Elastic at full resolution, through libigl."""

from __future__ import annotations

from sshade.solver.coarse import Start, libigl_arap
from sshade.task import DeformationResult, DeformationTask, Progress, silent


def arap(
    task: DeformationTask,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """ARAP: the spokes energy of Sorkine and Alexa (2007); see :func:`sshade.solver.coarse.libigl_arap`."""
    return libigl_arap(
        task,
        energy="spokes",
        tolerance=tolerance,
        max_iterations=max_iterations,
        start=start,
        seed=seed,
        progress=progress,
    )


def elastic(
    task: DeformationTask,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Elastic: the spokes-and-rims energy of Chao et al. (2010); see :func:`libigl_arap`."""
    return libigl_arap(
        task,
        energy="spokes_and_rims",
        tolerance=tolerance,
        max_iterations=max_iterations,
        start=start,
        seed=seed,
        progress=progress,
    )
