"""The rest shape with its handles moved: what doing nothing costs."""

from __future__ import annotations

from sshade.progress import Progress, silent
from sshade.solver.start import initial_guess
from sshade.task import DeformationResult, DeformationTask


def identity(task: DeformationTask, *, seed: int = 0, progress: Progress = silent) -> DeformationResult:
    """Put each handle on its target and leave every other vertex where it is.

    A floor for the tables: exact handles, nothing else. `seed` and `progress` are unused.
    """
    task.handles.require_hard("identity")
    return DeformationResult(vertices=initial_guess(task, "rest"), iterations=0, converged=None)
