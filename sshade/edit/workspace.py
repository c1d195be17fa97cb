"""The states of a session, its recovery file, and the shape that is shown."""

from __future__ import annotations

from dataclasses import replace
from threading import RLock
from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.edit.document import Document
from sshade.edit.dragging import bound_again, bound_for_drag, step
from sshade.edit.groups import Group, Motion
from sshade.edit.recovery import Recovery
from sshade.edit.state import EditState, History
from sshade.method.bound import Bound, Deformer
from sshade.problem.handles import Handles


class Superseded(Exception):
    """The handles changed during a computation, whose result is therefore out of date."""


class Dragged(NamedTuple):
    """Groups as handles for the steps of a drag, with a method, and the mesh bound to them."""

    groups: tuple[Group, ...]
    handles: Handles
    method: str
    deformer: Deformer

    def is_bound_to(self, handles: Handles, method: str) -> bool:
        """Whether the mesh is bound to the same handle vertices, for the same method."""
        own = self.handles
        same = np.array_equal(own.index, handles.index) and np.array_equal(own.group, handles.group)
        return same and np.array_equal(own.weight, handles.weight) and self.method == method


class Workspace:
    """States of a document, and the shape of the current state.

    Every method may be called from any thread. :meth:`undo` reverts all changes, except for files that were
    saved. A :meth:`drag` counts as a change when :meth:`release` ends it.

    Parameters
    ----------
    document : Document
    begin : EditState
        Groups and options at the beginning, which count as saved.

    Attributes
    ----------
    document : Document
    history : History
    mesh : Mesh
        The surface in the file that can be deformed.
    recovery : Recovery
        Keeps the unsaved work in a file beside the mesh.
    version : int
        Increases with each change that a page shows, except for steps of a drag.
    trouble : str
        Why the recovery file could not be written; empty if it was.
    shown : (n, 3) float64
        Latest positions of the mesh: of a drag, or converged.
    """

    def __init__(self, document: Document, begin: EditState) -> None:
        self.document, self.mesh = document, document.mesh
        self.recovery = Recovery(document.path, self.mesh)
        self.trouble = ""
        self.version = 0
        self.shown = self.mesh.V
        self.history = History(self._with_rest(begin))
        self._revision = 0
        #: EditState whose groups, method and selection count as saved.
        self._saved = self.state
        self._lock = RLock()
        self._dragging = RLock()
        self._settling = RLock()
        #: Whether the handles moved since the last step of a drag.
        self._jumped = False
        self._dragged: Dragged | None = None

    @property
    def state(self) -> EditState:
        """Current state."""
        return self.history.state

    @property
    def is_converged(self) -> bool:
        """Whether the converged shape of the current handles is known and shown."""
        return self.state.shape is self.shown

    @property
    def is_unsaved(self) -> bool:
        """Whether there are groups that were not saved, or not with the current options."""
        state, saved = self.state, self._saved
        same = state.groups is saved.groups and state.made == saved.made
        return bool(state.groups) and not same

    def undo(self) -> None:
        """Return to the previous state, if there is one."""
        self._go(-1)

    def redo(self) -> None:
        """Revert the last undo."""
        self._go(1)

    def drag(self, number: int, motion: Motion) -> np.ndarray:
        """Show the mesh with a group moved from the place of its last release.

        Parameters
        ----------
        number : int
            Number of a moved group.
        motion : Motion

        Returns
        -------
        (n, 3) float64
            Positions of the mesh, which :attr:`shown` holds as well.

        Raises
        ------
        InputError
            When no group has the number, the group is fixed, or the mesh cannot be bound with these handles.
        """
        with self._dragging:
            with self._lock:
                before, state = self.state, self.state.moved(number, motion)
                self._revision += 1
                revision = self._revision
            dragged = self.bound(before)
            if self._jumped:
                dragged.deformer.reset()
                self._jumped = False
            shape = step(dragged.deformer, dragged.handles.at(*state.aims()))
            shape.setflags(write=False)
            with self._lock:
                if self._revision == revision:
                    self.shown = shape
        return shape

    def bound(self, state: EditState) -> Dragged:
        """Return the groups of a state as handles of a drag, with the mesh bound to them.

        Raises
        ------
        InputError
            When there are no groups, or the mesh cannot be bound with them.
        """
        with self._dragging:
            last, method = self._dragged, state.method
            if last is not None and last.groups is state.groups and last.method == method:
                return last
            handles = state.handles(self.mesh).with_portions(self.mesh)
            if last is None or last.method != method:
                deformer = bound_for_drag(self.mesh, handles, method)
            elif last.is_bound_to(handles, method):
                deformer = last.deformer
            else:
                deformer = bound_again(last.deformer, handles, method)
            self._dragged = Dragged(state.groups, handles, method, deformer)
            return self._dragged

    def release(self, number: int, motion: Motion) -> None:
        """End a drag; the group stays at its place.

        Raises
        ------
        InputError
            When there is no such group, or it is fixed.
        """
        with self._lock:
            self._push(self.state.moved(number, motion))

    def settle(self, progress: Progress = silent) -> None:
        """Compute the converged shape, as ``sshade deform`` does, unless it is known, and show it.

        Parameters
        ----------
        progress : Progress

        Raises
        ------
        InputError
            When the method refuses the handles.
        Superseded
            When the handles changed during the computation.
        """
        with self._settling:  # pages that show one session wait for the same shape
            with self._lock:
                state, revision = self.state, self._revision

            def watched(stage: str, done: int, total: int, note: str = "") -> None:
                if self._revision != revision:
                    raise Superseded
                progress(stage, done, total, note)

            V, quality = state.shape, state.quality
            if V is None:
                task = self.document.task(state)
                bound = Bound.of_task(task, state.resolved)
                V = bound.solve(task.handles, progress=watched).vertices
                quality = str(bound.quality(V))
            with self._lock:
                if self._revision != revision:
                    raise Superseded
                self.history.store_shape(state, V, quality)
                self.version += state.shape is None
                self.shown = V

    def _push(self, state: EditState) -> None:
        """Append a state. Its shape is unknown unless groups and method stay, or all groups are at rest."""
        before = self.state
        self.history.push(state if state.same_shape(before) else self._with_rest(state))
        self._advance(before)
        self._keep()

    def _with_rest(self, state: EditState) -> EditState:
        """Return a state with the rest shape if all groups are at rest, else without a shape."""
        return replace(state, shape=None if state.displaced(self.mesh) else self.mesh.V, quality="")

    def _keep(self) -> None:
        """Write the recovery file, or remove it if everything is saved."""
        picked = self.state.selection
        self.version += 1
        self.trouble = ""
        if not self.is_unsaved and (len(picked) == 0 or picked is self._saved.selection):
            self.recovery.remove()
            return
        try:
            self.recovery.write(self.state)
        except InputError as error:  # the work goes on without it
            self.trouble = str(error)

    def _go(self, step: int) -> None:
        with self._lock:
            before = self.state
            self.history.go(step)
            self._jumped |= self._advance(before)
            self._keep()

    def _advance(self, before: EditState) -> bool:
        """Return whether groups or options differ from `before`; then computations are out of date."""
        if self.state.same_shape(before):
            return False
        self._revision += 1
        if self.state.shape is not None:
            self.shown = self.state.shape
        return True
