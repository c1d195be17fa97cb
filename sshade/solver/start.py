"""Where iterative methods begin."""

from __future__ import annotations

import numpy as np

from sshade.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.options import Start
from sshade.task import DeformationTask

#: How far beside a handle with a known rotation points are that turn with it (x diagonal).
BESIDE = 1e-3


def initial_guess(task: DeformationTask, start: Start) -> np.ndarray:
    """The rest shape, or its best rigid motion, with the hard handles on their targets.

    Parameters
    ----------
    task : DeformationTask
    start : {"rest", "rigid"}
        ``rigid`` applies the rotation and translation that best carry the
        handles to their targets, weighted where all are soft; known rotations decide what these leave
        open. The task's own guess, if it has one, takes the place of either.

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
        source, target = V[handles.index], handles.target
        weights = None if handles.hard.any() else handles.stiffness
        if known := handles.prescribed_rotations:
            # Three more points beside each, so near that they decide only what the others leave open.
            vertex, turns = known
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
