"""Where iterative methods begin."""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.solver.options import Start
from sshade.task import DeformationTask


def initial_guess(task: DeformationTask, start: Start) -> np.ndarray:
    """The rest shape, or its best rigid motion, with the hard handles on their targets.

    Parameters
    ----------
    task : DeformationTask
    start : {"rest", "rigid"}
        ``rigid`` applies the rotation and translation that best carry the
        handles to their targets, weighted where all are soft. The task's own guess, if it has one, takes
        the place of either.

    Returns
    -------
    (n, 3) float64

    Raises
    ------
    InputError
        On an unknown start.
    """
    V, handles = task.mesh.V, task.handles
    if start not in ("rest", "rigid"):
        raise InputError(f"unknown start {start!r}; use 'rest' or 'rigid'")
    if task.guess is not None:
        U = np.array(task.guess, dtype=np.float64)
    elif start == "rest":
        U = V.copy()
    else:
        # Soft handles alone: as little as they may pull, of all rigid motions this is the minimum.
        weights = None if handles.hard.any() else handles.stiffness
        R, t = rigid_motion(V[handles.index], handles.target, weights=weights)
        U = V @ R.T + t
    U[handles.index[handles.hard]] = handles.target[handles.hard]
    return U
