"""Deform one mesh for many poses: bind it once, and start each pose from the pose before.

A pose whose handles moved little starts at the vertices of the pose before. It then takes a fraction of the
iterations of a single run, and stays in the same local minimum. A pose whose handles jumped starts as a
single run does, because a long way from another pose takes more iterations and may end in another local
minimum.

Nothing but the vertices goes from pose to pose: no multipliers, no quasi-Newton steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.method.deform import deform_task
from sshade.method.proxies import Proxies
from sshade.problem.handles import Handles
from sshade.problem.options import Options, accepted, require_method, resolve, takes_options
from sshade.problem.task import DeformationResult, DeformationTask

#: Largest move of a handle, as a fraction of the bounding-box diagonal, with which a pose starts from the
#: pose before. At 24 poses a second, a hand of a body moves by 0.05 in a fast throw.
NEAR_POSE = 0.1


class Sequence:
    """A mesh that is deformed for one pose after another, with the method that :func:`sshade.deform` uses.

    Parameters
    ----------
    task : DeformationTask
        Mesh, handle vertices, groups and weights of all poses. Its targets and its guess are not used.
    method : str
        See :func:`sshade.deform`. "fine" binds its proxy once, but prepares each polish anew; "paper" with
        ``accelerate=False`` does not bind.
    **options
        Options of the method, see :class:`sshade.problem.options.Options`.

    Raises
    ------
    TypeError
        When the task is no :class:`sshade.DeformationTask`.
    InputError
        On an unknown method or option.
    """

    def __init__(self, task: DeformationTask, *, method: str = "fast", **options: Any) -> None:
        if not isinstance(task, DeformationTask):
            raise TypeError(f"a sequence takes a DeformationTask, not a {type(task).__name__}")
        resolve(require_method(method), options)
        self.task, self._method, self._options = task, method, options
        self._kept: dict[bytes, Proxies] = {}

    def __call__(
        self,
        handles: Handles,
        *,
        after: tuple[Handles, np.ndarray] | None = None,
        progress: Progress = silent,
    ) -> DeformationResult:
        """Deform the mesh for a pose.

        Parameters
        ----------
        handles : Handles
            At their targets, and at the vertices of the task's handles, in the same order.
        after : (Handles, (n, 3) float64), optional
            The pose before, and its vertices. Without it the pose starts as a single run does.
        progress : Progress

        Returns
        -------
        DeformationResult
            As of :func:`sshade.deform`. ``facts.followed`` says whether the pose started from the one before.

        Raises
        ------
        InputError
            If the handles are not the handles of the task, or as :func:`sshade.deform`.
        """
        handles.require_same(self.task.handles)
        guess = None
        if after is not None and self._is_near(handles, after[0]):
            guess = self.task.mesh.checked(after[1], "pose before")
        pose = replace(self.task, handles=handles, guess=guess)
        kept = _Kept(self._kept)
        result = deform_task(pose, method=self._method, progress=progress, make_proxies=kept, **self._options)
        self._kept = kept.used
        result = replace(result, facts=replace(result.facts, followed=guess is not None))
        return result.of(self.task.at(pose.handles))

    def _is_near(self, handles: Handles, before: Handles) -> bool:
        """Whether no handle moved farther than :data:`NEAR_POSE` since the pose before."""
        step = np.linalg.norm(handles.target - before.target, axis=1).max()
        return bool(step <= NEAR_POSE * self.task.mesh.diagonal)


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
        See :func:`sshade.deform`.
    progress : Progress
        Solves of a proxy that is bound once report nothing.

    Yields
    ------
    DeformationResult
        See :func:`sshade.deform`.

    Raises
    ------
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
    return _deformed_poses(Sequence(task, method=method, **options), poses, progress)


def _deformed_poses(
    sequence: Sequence, poses: Iterable[Handles | np.ndarray], progress: Progress
) -> Iterator[DeformationResult]:
    """Yield the result of each pose, which the caller may change."""
    after = None
    for pose in poses:
        own = sequence.task.handles
        handles = pose if isinstance(pose, Handles) else own.at(pose, own.rotation)
        result = sequence(handles, after=after, progress=progress)
        after = handles, result.vertices.copy()
        yield result


@dataclass
class _Kept:
    """Gives the proxies of each piece of a mesh, which later poses use again.

    Parameters
    ----------
    known, used : mapping
        Proxies of the pose before, and of this pose, by a hash of all that determines them.
    """

    known: Mapping[bytes, Proxies]
    used: dict[bytes, Proxies] = field(default_factory=dict)

    def __call__(self, mesh: Mesh, handles: Handles, options: Options) -> Proxies:
        if options.coarse is not None or not options.accelerate:
            return Proxies(mesh, handles, options)
        kinds = handles.index, handles.group, handles.weight, handles.has_rotation
        key = blake2b(repr(options).encode())
        for array in (mesh.V, mesh.F, *kinds):
            key.update(np.ascontiguousarray(array).tobytes())
        known = key.digest()
        proxies = self.used.get(known) or self.known.get(known) or Proxies(mesh, handles, options, keep=True)
        self.used[known] = proxies
        proxies.reset()
        return proxies
