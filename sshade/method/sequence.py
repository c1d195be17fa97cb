"""Deform one mesh for many poses: bind it once, and start each pose from the pose before.

A pose whose handles moved little starts at the vertices of the pose before. It then takes a fraction of the
iterations of a single run, and stays in the same local minimum. A pose whose handles jumped starts as a
single run does, because a long way from another pose takes more iterations and may end in another local
minimum.

Nothing but the vertices goes from pose to pose: no multipliers, no quasi-Newton steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.method.bound import Bound
from sshade.problem.handles import Handles
from sshade.problem.options import accepted, require_method, resolve, takes_options
from sshade.problem.task import DeformationResult, DeformationTask

#: Largest move of a handle, as a fraction of the bounding-box diagonal, with which a pose starts from the
#: pose before. At 24 poses a second, a hand of a body moves by 0.05 in a fast throw.
NEAR_POSE = 0.1


@takes_options(lambda given: (*accepted(given.get("method", "fast")), "progress"))
def deform_sequence(
    task: DeformationTask,
    poses: Iterable[Handles | np.ndarray],
    *,
    method: str = "fast",
    progress: Progress = silent,
    **options: Any,
) -> Iterator[DeformationResult]:
    """Deform a mesh for poses that follow each other; yield a result for each pose.

    The mesh is bound once. A pose starts from the result of the pose before if no handle moved farther than a
    tenth of the bounding-box diagonal, and as :func:`sshade.deform` otherwise. Each result is converged to
    the method's ``tolerance``; lower it if slow motions must follow the minimum more closely.

    Parameters
    ----------
    task : DeformationTask
        Rest mesh and handles. The targets of its handles and its guess are not used.
    poses : iterable of Handles or (k, 3) float64
        Handles of each pose, or the targets of the task's handles. It may be a generator: a pose is taken
        when its result is asked for.
    method, **options
        See :func:`sshade.deform`. "fine" binds its proxy once, but prepares each polish anew; "paper" with
        ``accelerate=False`` does not bind.
    progress : Progress
        Solves of a proxy that is bound once report nothing.

    Yields
    ------
    DeformationResult
        See :func:`sshade.deform`. ``facts.followed`` says whether a pose started from the one before.

    Raises
    ------
    TypeError
        When the task is no :class:`sshade.DeformationTask`.
    InputError
        If a pose has other handles than the task, or as :func:`sshade.deform`.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import DeformationTask, Handles, Mesh, deform_sequence
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> rest = V[[0, 2]]
    >>> task = DeformationTask("lift", Mesh(V, np.array([[0, 1, 2], [0, 2, 3]])), Handles([0, 2], rest))
    >>> results = deform_sequence(task, [rest + [0, 0, 0.5], rest + [0, 0, 1]])
    >>> [round(float(result.vertices[1, 2]), 3) for result in results]
    [0.5, 1.0]
    """
    if not isinstance(task, DeformationTask):
        raise TypeError(f"a sequence takes a DeformationTask, not a {type(task).__name__}")
    bound = Bound.of_task(task, resolve(require_method(method), options), keep=True)
    return solved_poses(bound, task, poses, progress=progress)


def solved_poses(
    bound: Bound,
    task: DeformationTask,
    poses: Iterable[Handles | np.ndarray],
    *,
    progress: Progress = silent,
) -> Iterator[DeformationResult]:
    """Yield the result of each pose, which the caller may change; see :func:`deform_sequence`."""
    own, before, shape = task.handles, None, None
    for pose in poses:
        handles = pose if isinstance(pose, Handles) else own.at(pose, own.rotation)
        handles.require_same(own)
        if before is not None:
            step = np.linalg.norm(handles.target - before.target, axis=1).max()
            if step > NEAR_POSE * task.mesh.diagonal:
                shape = None
        result = bound.solve(handles, guess=shape, progress=progress)
        followed = shape is not None
        before, shape = handles, result.vertices.copy()
        yield replace(result, facts=replace(result.facts, followed=followed))
