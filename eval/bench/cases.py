"""What is timed: methods and cases, and what a method is given in each call."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import igl
import numpy as np

from eval.metrics import Task
from eval.run.config import task_of
from eval.run.run import given
from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, TransferTask

#: Distance by which the targets of a call differ from the task, as a fraction of the diagonal.
HAIR = 1e-6


class TimedMethod(NamedTuple):
    """A method by its name in tables, its configuration, and whether its time is extrapolated."""

    label: str
    config: dict[str, Any]
    extrapolated: bool = False


class TimedCase(NamedTuple):
    """The configuration that loads a task, and a number of midpoint subdivisions; None keeps the task."""

    source: dict[str, Any]
    level: int | None = None

    def load(self) -> Task:
        """Load the task and subdivide it. Subdivision keeps the vertices and the handles on them."""
        task = task_of(self.source, truth=False)
        if self.level is None:
            return task
        task = deformation(task)
        V, F = igl.upsample(np.array(task.mesh.V), np.array(task.mesh.F), self.level)
        return DeformationTask(f"{task.name}, level {self.level}", Mesh(V, F), task.handles)


def deformation(task: Task) -> DeformationTask:
    """Return a task of a deformation; raise InputError for a pose transfer."""
    if not isinstance(task, DeformationTask):
        raise InputError(f"{task.name} is a pose transfer; only `speed` times transfers, without --sizes")
    return task


def moved(task: Task, number: int) -> Task:
    """Return what a method is given in a call: new meshes, a hash as name, and targets moved by a hair.

    Each group of moved handles, or the pose of a transfer, is moved by :data:`HAIR` diagonals. Each number
    has another direction.
    """
    task = given(task)
    rng = np.random.default_rng(number)
    if isinstance(task, TransferTask):
        return replace(task, posed=task.posed + _hair(rng, 1) * task.mesh.diagonal)
    handles = task.handles
    _, group = np.unique(handles.group, return_inverse=True)
    shift = _hair(rng, group.max() + 1)[group] * task.mesh.diagonal
    moves = handles.dynamic if handles.dynamic.any() else ~handles.dynamic
    target = np.where(moves[:, None], handles.target + shift, handles.target)
    return replace(task, handles=replace(handles, target=target))


def _hair(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return vectors (count, 3) of the length :data:`HAIR`."""
    directions = rng.normal(size=(count, 3))
    return HAIR * directions / np.linalg.norm(directions, axis=1, keepdims=True)
