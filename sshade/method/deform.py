"""Deform the mesh of a task, component by component."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.method.components import by_components
from sshade.method.dense_handles import interpolate_handles
from sshade.method.engine import deform_once
from sshade.method.goals import goal_error, warn_of_missed, with_goal
from sshade.method.polish import polished
from sshade.method.regions import all_on_targets, has_regions
from sshade.problem.options import as_row, resolve
from sshade.problem.task import DeformationResult, DeformationTask


def deform_task(
    task: DeformationTask,
    *,
    method: str,
    progress: Progress = silent,
    once: Callable[..., DeformationResult] = deform_once,
    **values: Any,
) -> DeformationResult:
    """Deform the mesh of a task, component by component.

    Parameters
    ----------
    task : DeformationTask
    method : str
        A key of :data:`sshade.problem.options.PRESETS`.
    progress : Progress
    once : callable
        Takes the place of :func:`sshade.method.engine.deform_once`, or is that function with another
        ``sample`` or ``projection``, for ablations.
    **values
        Options, see :class:`sshade.problem.options.Options`; None stands for the method's own value.

    Returns
    -------
    DeformationResult
        See :func:`deform`.
    """

    def deform_component(task: DeformationTask, *, progress: Progress, **changes: Any) -> DeformationResult:
        component_values = {**values, **changes}
        options = resolve(method, component_values)
        if regional := has_regions(task.mesh, task.handles.index, options):
            options = resolve(method, component_values, regions=True)
        options = with_goal(task.mesh, options, area=area)
        run = partial(once, task, options.of_proxy(), progress=progress)
        if task.handles.hard.sum() == task.mesh.n:
            result = all_on_targets(task)
        elif options.polish:
            result = polished(task, options, deform=run, regional=regional, progress=progress)
        else:
            result = run()
        totals = replace(options, **whole.subset(("vertices", "polish_seconds", "volume", "volume_goal")))
        extra = {**result.extra, "options": as_row(totals, method)}
        if options.volume_goal is not None:
            extra["volume_goal_error"] = goal_error(task.mesh, result.vertices, options.volume_goal)
            if options.volume == inf:
                warn_of_missed(extra["volume_goal_error"])
        return replace(result, extra=extra)

    if method == "interpolate":
        resolve(method, values)
        return interpolate_handles(task, progress=progress)
    area = values.get("area") is not None
    whole = resolve(method, values)
    result = by_components(task, deform_component, whole, progress=progress)
    facts = {"options": as_row(whole, method), "hard_handle_error": _hard_error(task, result.vertices)}
    return replace(result, extra={**facts, **result.extra})


def _hard_error(task: DeformationTask, V: np.ndarray) -> float:
    """Return the largest distance of a hard handle from its target, as a fraction of the diagonal."""
    handles = task.handles
    distance = np.linalg.norm(V[handles.index] - handles.target, axis=1)[handles.hard]
    return float(distance.max(initial=0.0)) / task.mesh.diagonal
