"""The solver of a proxy that is kept for targets that follow each other."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.method.start import solve_from_start, solver_threads
from sshade.problem.options import ENERGY, Options
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.solver.attachment import Attachment
from sshade.solver.following import Following
from sshade.solver.local_global import LocalGlobal
from sshade.solver.run import initial_guess


class FollowingSolver:
    """Solve a proxy from where its last solve ended, with one factorisation for all targets.

    The first solve starts as the method does. After a change of the handles, the next solve starts from the
    last shape.

    Parameters
    ----------
    proxy : Mesh
        N.
    handles : Handles
        On N, at rest.
    options : Options
    """

    def __init__(self, proxy: Mesh, handles: Handles, options: Options) -> None:
        self._proxy, self._options = proxy, options
        #: Handles whose rotations the attachment knows. A new one needs another attachment.
        self._rotated = handles.has_rotation
        self._attachment = Attachment(proxy, handles, options.attachment)
        attachment = self._attachment
        self._solver = LocalGlobal(
            proxy,
            attachment.vertex,
            stiffness=attachment.stiffness,
            bending=options.bending,
            thickness=options.thickness,
            inertia=options.inertia,
        )
        self._solver.factorise()
        self.reset()

    @property
    def at_start(self) -> bool:
        """Whether no solve has run yet with the present handles and energy."""
        return self._following is None

    def reset(self) -> None:
        """Forget the last solve, its shape and rotations."""
        self._following: Following | None = None
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def start_at(self, V: np.ndarray) -> None:
        """Start the next solve at positions V (k, 3) of the proxy's vertices."""
        self._following = None
        self._last = V, np.tile(np.eye(3), (len(V), 1, 1))

    def with_handles(self, handles: Handles) -> FollowingSolver:
        """Return a solver for other handles on N, which starts at the present shape."""
        other = copy(self)
        other._take(handles)
        return other

    def _take(self, handles: Handles) -> None:
        attachment = Attachment(self._proxy, handles, self._options.attachment)
        self._solver = self._solver.with_handles(attachment.vertex, stiffness=attachment.stiffness)
        self._attachment, self._rotated, self._following = attachment, handles.has_rotation, None

    def __call__(self, handles: Handles, *, volume_goal: float, **stop: Any) -> DeformationResult:
        if (handles.has_rotation & ~self._rotated).any():
            self._take(handles)
        targets, fraction = self._attachment.pulls(handles.target, handles.rotation)
        aim: dict[str, Any] = {"targets": targets, "fraction": fraction, "volume_goal": volume_goal}
        aim |= {"prescribed": handles.prescribed_rotations, "majority": handles.majority}
        energy: dict[str, Any] = self._options.subset(ENERGY)
        energy["workers"] = solver_threads(self._options, self._proxy.n)
        if self._following is None and self._last is not None:
            at = self._last[0][self._solver.index]
            self._following = Following(self._solver, *self._last, at, **energy)
        try:
            if self._following is None:
                result = self._first(handles, aim, replace(self._options, **stop))
                R = result.extra["rotations"]
                self._following = Following(self._solver, result.vertices, R, **aim, **energy)
            else:
                result = self._following.solve(**aim, **stop).result()
        except FloatingPointError:  # the positions are of no use to the next solve
            self.reset()
            raise
        self._last = result.vertices, result.extra["rotations"]
        return result

    def _first(self, handles: Handles, aim: Mapping[str, Any], options: Options) -> DeformationResult:
        task, goal = DeformationTask("drag", self._proxy, handles), aim["volume_goal"]
        solve = partial(self._solve, aim=aim, options=options)
        if not options.coarser_start:
            return solve(task, tolerance=options.tolerance, progress=silent)
        reports = {"progress": silent, "coarser_progress": silent}
        return solve_from_start(task, options, solve, volume_goal=goal, **reports)

    def _solve(
        self,
        task: DeformationTask,
        *,
        aim: Mapping[str, Any],
        options: Options,
        tolerance: float,
        progress: Progress,
        softened: bool = False,
    ) -> DeformationResult:
        """Solve with the factorisation, from the task's guess or the plain start."""
        solution = self._solver.solve(
            start=initial_guess(task, options.start),
            tolerance=tolerance,
            max_iterations=options.max_iterations,
            workers=solver_threads(options, task.mesh.n),
            softened=softened,
            progress=progress,
            **aim,
            **options.subset(ENERGY),
        )
        return solution.result()
