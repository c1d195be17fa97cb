"""The rigid motion with which a method begins that has other unknowns than the mesh's vertices."""

from __future__ import annotations

from typing import get_args

import numpy as np

from sshade.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.solver.options import Start
from sshade.task import DeformationTask


def start_motion(task: DeformationTask, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """R (3, 3) and t (3,): none for "rest", the best one of the handles for "rigid".

    Raises
    ------
    InputError
        On an unknown start.
    """
    if start not in get_args(Start):
        raise InputError(f"unknown start {start!r}; use 'rest' or 'rigid'")
    if start == "rest":
        return np.eye(3), np.zeros(3)
    return rigid_motion(task.mesh.V[task.handles.index], task.handles.target)
