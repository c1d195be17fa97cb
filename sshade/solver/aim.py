"""What a solve aims at, and the shape in which it begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.rigid import rigid_motion
from sshade.problem.options import Start
from sshade.problem.task import DeformationTask

#: Distance of the auxiliary points beside a handle with a prescribed rotation, as a fraction of the diagonal.
BESIDE = 1e-3


@dataclass(frozen=True)
class Aim:
    """What a solve aims at; a solver may be given one aim after another.

    Attributes
    ----------
    targets : (k, 3) float64
        Positions of the handle vertices, in the order of the solver's `index`.
    prescribed : ((j,) int, (j, 3, 3) float64), optional
        Vertices, each once, and their prescribed rotations, which the local step does not fit. See
        :attr:`sshade.Handles.prescribed_rotations`.
    fraction : (k,) float64, optional
        Fraction of the stiffness of each soft handle, in [0, 1]; 1 if missing. It may vary from solve to
        solve with one factorisation.
    volume_goal : float
        Volume to reach if the volume is constrained, as a multiple of the volume at rest; positive.
    yields : bool
        Whether exact constraints yield beyond :data:`sshade.solver.constraints.PRESSURE`.
    """

    targets: np.ndarray
    prescribed: tuple[np.ndarray, np.ndarray] | None = None
    fraction: np.ndarray | None = None
    volume_goal: float = 1.0
    yields: bool = False


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
