"""The solver of a proxy that is kept for targets that follow each other."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sshade.core.progress import silent
from sshade.core.threads import Later
from sshade.mesh.mesh import Mesh
from sshade.method.start import solve_from_start, solver_threads
from sshade.problem.options import ENERGY, MATRIX, Options
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.solver.attachment import Attachment
from sshade.solver.following import Following
from sshade.solver.local_global import LocalGlobal, Prepared, solve_task
from sshade.solver.run import Aim


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
        vertex, stiffness = self._attachment.vertex, self._attachment.stiffness
        self._solver = LocalGlobal(proxy, vertex, stiffness=stiffness, **options.subset(MATRIX))
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
        aim = Aim(targets, handles.prescribed_rotations, fraction, volume_goal, handles.majority)
        energy: dict[str, Any] = self._options.subset(ENERGY)
        energy["workers"] = solver_threads(self._options, self._proxy.n)
        if self._following is None and self._last is not None:
            at = Aim(self._last[0][self._solver.index])
            self._following = Following(self._solver, *self._last, at, **energy)
        try:
            if self._following is None:
                result = self._first(handles, aim, replace(self._options, **stop))
                R = result.extra["rotations"]
                self._following = Following(self._solver, result.vertices, R, aim, **energy)
            else:
                result = self._following.solve(aim, **stop).result()
        except FloatingPointError:  # the positions are of no use to the next solve
            self.reset()
            raise
        self._last = result.vertices, result.extra["rotations"]
        return result

    def _first(self, handles: Handles, aim: Aim, options: Options) -> DeformationResult:
        """Solve as the method does, with the factorisation."""
        task, prepared = DeformationTask("drag", self._proxy, handles), Prepared(self._solver, aim)
        workers = solver_threads(options, self._proxy.n)
        solve = partial(solve_task, prepared=Later(lambda: prepared), options=options, workers=workers)
        if not options.coarser_start:
            return solve(task, tolerance=options.tolerance, progress=silent)
        reports = {"progress": silent, "coarser_progress": silent}
        return solve_from_start(task, options, solve, volume_goal=aim.volume_goal, **reports)
