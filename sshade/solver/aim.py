"""What a solve aims at, and the shape in which it begins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.problem.handles import Handles
from sshade.problem.options import Options, Start
from sshade.problem.task import DeformationTask

#: Distance of the auxiliary points beside a handle with a prescribed rotation, as a fraction of the diagonal.
BESIDE = 1e-3
#: Largest pressure of an exact volume and of an exact area. Poses of bodies and animals need up to 0.004 and
#: 0.013; a handle that pushes a spot out of a surface, and handles that imply another volume, ask for more.
PRESSURE = 0.012, 0.03
#: Share of the area in handles at rest, less the share in others, over which the limit of the volume falls to
#: the fraction `LEAST`. Handle regions of posed bodies have up to 0.08.
LOCAL, LEAST = (0.15, 0.35), 1e-3
#: Move up to which a handle is at rest in part, as a fraction of the largest move.
RESTING = 0.5


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
    pressure : (float, float)
        Largest pressures of an exact volume and an exact area; see :mod:`sshade.solver.constraints`.
    """

    targets: np.ndarray
    prescribed: tuple[np.ndarray, np.ndarray] | None = None
    fraction: np.ndarray | None = None
    volume_goal: float = 1.0
    pressure: tuple[float, float] = (math.inf, math.inf)


def share_at_rest(mesh: Mesh, index: np.ndarray, at_rest: np.ndarray) -> float:
    """Return the share of the area at handles (k,) at rest, less the share at others.

    `at_rest` (k,) is 1 for a handle at rest, 0 for a handle that moves, or between.
    """
    return float((2.0 * at_rest - 1.0) @ mesh.vertex_areas[index]) / (mesh.area or 1.0)


def largest_pressures(mesh: Mesh, handles: Handles, options: Options) -> tuple[float, float]:
    """Return the largest pressures of an exact volume and an exact area.

    They are infinite for a volume goal. In a local edit, where handles at rest fix much of the surface and
    few others move, what these add to the volume would have to sink in between. The limit of the volume
    therefore falls with the area that is at rest, less the area that moves.
    """
    if not options.yields:
        return math.inf, math.inf
    moved = np.linalg.norm(handles.target - mesh.V[handles.index], axis=1)
    at_rest = np.clip(1.0 - moved / (RESTING * (moved.max() or 1.0)), 0.0, 1.0)
    share = share_at_rest(mesh, handles.index, at_rest)
    exact = float(np.clip((LOCAL[1] - share) / (LOCAL[1] - LOCAL[0]), LEAST, 1.0))
    return exact * PRESSURE[0], PRESSURE[1]


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
