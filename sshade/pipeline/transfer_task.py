"""Pose transfer as a task that methods are measured on, and SShaDe as such a method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from sshade.carry.frames import FrameKind
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.pipeline.transfer import transfer_pose
from sshade.task import DeformationResult, Progress, silent


@dataclass(frozen=True, eq=False)
class TransferTask:
    """One pose transfer: put an edited shape into the pose of the shape that it was made from.

    With the unedited shape as `mesh` this is isometric reconstruction: a method is
    then trusted to look at `posed` at its samples only.

    Parameters
    ----------
    name : str
    mesh : Mesh
        S, the edited shape at rest: what is to be deformed.
    rest : Mesh
        M, with the faces of S.
    posed : (n, 3) float64
        M', the pose of M.
    truth : (n, 3) float64, optional
        S', the true result, where it is known.
    meta : mapping
        Flat facts for the row of a table (subject, pose, edit, ...).

    Raises
    ------
    InputError
        When S, M, M' and the truth do not correspond, or a position is not finite.
    """

    name: str
    mesh: Mesh
    rest: Mesh
    posed: np.ndarray
    truth: np.ndarray | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not np.array_equal(self.mesh.F, self.rest.F):
            raise InputError("the edited shape has other faces than the rest shape; they must correspond")
        for name in ("posed", "truth"):
            values = getattr(self, name)
            if values is None:
                continue
            if np.shape(values) != self.mesh.V.shape:
                raise InputError(
                    f"the {name} shape has vertices of shape {np.shape(values)}, the mesh "
                    f"{self.mesh.V.shape}; they must correspond"
                )
            if not np.isfinite(values).all():
                raise InputError(f"the {name} shape has a NaN or infinite coordinate")


def transfer(
    task: TransferTask,
    *,
    vertices: int = 6000,
    samplings: int = 10,
    frames: FrameKind = "triangle",
    frame_function: str = "extent",
    projection: Literal["fan", "surface"] = "fan",
    residual: bool = False,
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """:func:`sshade.transfer_pose` as a method of a task; the parameters are its own.

    Without `residual`, only the samples of M' are used, so a task whose truth is M' is an honest one.

    Raises
    ------
    InputError
        When the mesh or a parameter is out of what :func:`sshade.transfer_pose` takes.
    """
    return transfer_pose(
        task.rest,
        task.posed,
        task.mesh.V,
        vertices=vertices,
        samplings=samplings,
        frames=frames,
        frame_function=frame_function,
        projection=projection,
        residual=residual,
        workers=workers,
        seed=seed,
        progress=progress,
    )
