"""Measures of a result, with the targets of sliding handles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eval.metrics import Task, measure
from sshade.task import DeformationTask


def measures_of(task: Task, vertices: np.ndarray) -> dict[str, float | None]:
    """Return the measures of deformed vertices (n, 3), as of :func:`eval.metrics.measure`.

    The target of a handle that slides is the nearest place where it may be. This is done here, because the
    code of :mod:`eval.metrics` is the version of the measures, and all other rows keep their values.

    Raises
    ------
    InputError
        As :func:`eval.metrics.measure`.
    """
    if isinstance(task, DeformationTask) and task.handles.slide is not None:
        goals = task.handles.goals(task.mesh.checked(vertices, "result"))
        task = replace(task, handles=task.handles.at(goals, task.handles.rotation))
    return measure(task, vertices)
