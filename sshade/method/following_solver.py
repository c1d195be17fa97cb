"""The solver of a proxy that is kept for targets that follow each other."""

from __future__ import annotations

from copy import copy
from functools import partial

import numpy as np

from sshade.core.progress import silent
from sshade.core.threads import Later
from sshade.mesh.mesh import Mesh
from sshade.method.start import solve_from_start, solver_threads
from sshade.problem.options import Options
from sshade.problem.stop import Stop
from sshade.problem.task import DeformationTask, Handles
from sshade.solver.aim import Aim
from sshade.solver.attachment import Attachment
from sshade.solver.following import Following
from sshade.solver.local_global import Prepared, solve_task
from sshade.solver.solution import Solution
from sshade.solver.system import System


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
        self._proxy = proxy
        self._options = options
        #: Handles whose rotations the attachment knows. A new one needs another attachment.
        self._rotated = handles.has_rotation
        self._attachment = Attachment(proxy, handles, options.attachment)
        self._system = System(proxy, self._attachment.vertex, options, stiffness=self._attachment.stiffness)
        self._system.factorise()
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
        self._system = self._system.with_handles(attachment.vertex, stiffness=attachment.stiffness)
        self._attachment = attachment
        self._rotated = handles.has_rotation
        self._following = None

    def __call__(self, handles: Handles, *, volume_goal: float, stop: Stop) -> Solution:
        if (handles.has_rotation & ~self._rotated).any():
            self._take(handles)
        targets, fraction = self._attachment.pulls(handles.target, handles.rotation)
        aim = Aim(targets, handles.prescribed_rotations, fraction, volume_goal, handles.majority)
        options, workers = self._options, solver_threads(self._options, self._proxy.n)
        if self._following is None and self._last is not None:
            at = Aim(self._last[0][self._system.handles.index])
            self._following = Following(self._system, *self._last, at, options, workers=workers)
        try:
            if self._following is None:
                found = self._first(handles, aim, stop)
                V, R = found.positions, found.rotations
                assert R is not None
                self._following = Following(self._system, V, R, aim, options, workers=workers)
            else:
                found = self._following.solve(aim, stop)
        except FloatingPointError:  # the positions are of no use to the next solve
            self.reset()
            raise
        assert found.rotations is not None
        self._last = found.positions, found.rotations
        return found

    def _first(self, handles: Handles, aim: Aim, stop: Stop) -> Solution:
        """Solve as the method does, with the factorisation."""
        options = self._options
        task, prepared = DeformationTask("drag", self._proxy, handles), Prepared(self._system, aim)
        workers = solver_threads(options, self._proxy.n)
        solve = partial(solve_task, prepared=Later(lambda: prepared), options=options, workers=workers)
        if not options.coarser_start:
            return solve(task, stop=stop, progress=silent)
        return solve_from_start(
            task,
            options,
            solve,
            volume_goal=aim.volume_goal,
            stop=stop,
            progress=silent,
            coarser_progress=silent,
        )
