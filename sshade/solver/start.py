"""The shape in which iterative methods begin."""

from __future__ import annotations

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.problem.options import Start
from sshade.problem.task import DeformationTask

#: Distance of the auxiliary points beside a handle with a prescribed rotation, as a fraction of the diagonal.
BESIDE = 1e-3


def initial_guess(task: DeformationTask, start: Start) -> np.ndarray:
    """Return the rest shape, or its best rigid motion to the handles, with hard handles on their targets.

    Parameters
    ----------
    task : DeformationTask
    start : {"rest", "rigid"}
        ``rigid`` applies the best rotation and translation of the handles to their targets, weighted by
        stiffness if all handles are soft. Prescribed rotations decide if the positions leave the rotation
        undetermined. If the task has a guess, it takes the place of both.

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
        # The weighted fit of soft handles is the minimum of the energy over all rigid motions.
        source, target = V[handles.index], handles.target
        weights = None if handles.hard.any() else handles.stiffness
        if prescribed := handles.prescribed_rotations:
            # Three auxiliary points beside each such handle, near enough not to disturb the fit of positions.
            vertex, turns = prescribed
            number = np.flatnonzero(np.isin(handles.index, vertex))
            beside = BESIDE * task.mesh.diagonal * np.eye(3)
            source = np.concatenate([source, (V[vertex, None] + beside).reshape(-1, 3)])
            turned = target[number, None] + beside @ turns.transpose(0, 2, 1)
            target = np.concatenate([target, turned.reshape(-1, 3)])
            if weights is not None:
                weights = np.concatenate([weights, np.repeat(weights[number], 3)])
        R, t = rigid_motion(source, target, weights=weights)
        U = V @ R.T + t
    U[handles.index[handles.hard]] = handles.target[handles.hard]
    return U
