"""The rest shape with its handles moved: a reference that every method should beat.

Proof: a closed form, the positions at rest (tests/baselines/test_common.py).
"""

from __future__ import annotations

from baselines.hard_handles import require_hard
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationResult, DeformationTask


def identity(task: DeformationTask, *, seed: int = 0, progress: Progress = silent) -> DeformationResult:
    """Put each handle on its target; leave every other vertex at rest. `seed` and `progress` are unused."""
    require_hard(task.handles, "identity")
    V = task.mesh.V.copy()
    V[task.handles.index] = task.handles.target
    return DeformationResult(vertices=V, iterations=0, converged=None)
