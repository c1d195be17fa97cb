"""The initial rigid motion of methods whose unknowns are not the vertices of the mesh."""

from __future__ import annotations

from typing import get_args

import numpy as np

from sshade.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.options import Start
from sshade.task import DeformationTask


def start_motion(task: DeformationTask, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Return R (3, 3) and t (3,): the identity for "rest", the best rigid motion of the handles for "rigid".

    Raises
    ------
    InputError
        If the start is unknown.
    """
    if start not in get_args(Start):
        raise InputError(f"unknown start {start!r}; use 'rest' or 'rigid'")
    if start == "rest":
        return np.eye(3), np.zeros(3)
    return rigid_motion(task.mesh.V[task.handles.index], task.handles.target)
