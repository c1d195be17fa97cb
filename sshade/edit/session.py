"""What a person does to a mesh and its handles, one call each; it knows of no browser."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import RLock, Thread
from typing import Any

import numpy as np

from sshade.edit.document import Document
from sshade.edit.follower import Follower, settled
from sshade.edit.history import History
from sshade.edit.saving import Outputs
from sshade.edit.selecting import selected
from sshade.edit.state import Group, Kind, Motion, Settings, State
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.progress import Progress, silent

#: Where all of a new static group is this near to rest, over the diagonal, it is at rest.
AT_REST = 1e-6


class Superseded(Exception):
    """What was computed is out of date: the handles have changed meanwhile."""


class Session:
    """A mesh, what is picked of it, its handle groups, and a history of these.

    Every method may be called from any thread. Those that change something are undone by :meth:`undo`, but
    for :meth:`drag`, which :meth:`release` ends, and the saving of files.

    Parameters
    ----------
    path : path
        Of the mesh: any that ``sshade deform`` takes.
    handles : path, optional
        A handle file to begin with.
    output, handles_output : path, optional
        See :class:`sshade.edit.saving.Outputs`.
    settings : Settings
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.

    Attributes
    ----------
    document : Document
    history : History
    mesh : Mesh
        What can be deformed of the file.
    shown : (n, 3) float64
        The latest shape: of a drag, or of the handles at rest.

    Raises
    ------
    InputError
        On files that cannot be read, or written.
    """

    def __init__(
        self,
        path: Path,
        *,
        handles: Path | None = None,
        output: Path | None = None,
        handles_output: Path | None = None,
        settings: Settings = Settings(),  # noqa: B008  (immutable)
        carry_unconstrained: bool = False,
    ) -> None:
        outputs = Outputs(path, output=output, handles=handles_output)
        self.document = Document(path, outputs, carry_unconstrained=carry_unconstrained)
        self.mesh = mesh = self.document.mesh
        self.shown = mesh.V
        self.history = History(State(settings=settings, shape=mesh.V))
        self._revision, self._number = 0, 1
        self._saved: tuple[Group, ...] = ()
        self._lock, self._following = RLock(), RLock()
        self._follower = Follower(mesh)
        #: Whether the handles are elsewhere than a drag left them.
        self._jumped = False
        #: The groups of the last step of a drag, and its handles.
        self._dragged: tuple[tuple[Group, ...], Handles] | None = None
        if handles is not None:
            self._take(self.document.read_groups(handles, first=1))
            self.history = History(self.state)

    @property
    def state(self) -> State:
        """The present one."""
        return self.history.state

    @property
    def is_settled(self) -> bool:
        """Whether the shape of the present handles is known, and shown."""
        return self.state.shape is self.shown

    @property
    def is_unsaved(self) -> bool:
        """Whether there are groups that no file has."""
        return bool(self.state.groups) and self.state.groups is not self._saved

    # What can be undone.

    def select(self, vertices: np.ndarray, how: str) -> None:
        """Pick vertices.

        Parameters
        ----------
        vertices : (k,) int
        how : str
            See :func:`sshade.edit.selecting.selected`.

        Raises
        ------
        InputError
            On a vertex out of range or another word.
        """
        with self._lock:
            new = selected(self.mesh, self.state.selection, np.asarray(vertices), how)
            if not np.array_equal(new, self.state.selection):
                self._push(replace(self.state, selection=new))

    def mark(self, kind: Kind) -> int:
        """Make a group of the vertices that are picked, where they are now; return its number.

        They leave the groups that had them.

        Raises
        ------
        InputError
            When nothing is picked, or on another kind.
        """
        with self._lock:
            own = self.state.selection
            if len(own) == 0:
                raise InputError("nothing is picked; pick vertices by click, brush, rectangle or lasso first")
            start, rest = self.shown[own], self.mesh.V[own]
            if kind == "static" and np.abs(start - rest).max() <= AT_REST * self.mesh.diagonal:
                start = rest
            number, self._number = self._number, self._number + 1
            new = Group(number, f"group {number}", kind, own, start)
            self._push(self.state.marked(new))
        self._prepare(new)
        return number

    def remove(self, number: int) -> None:
        """Let the vertices of a group go."""
        with self._lock:
            own = self.state.group(number)
            self._push(replace(self.state, groups=tuple(g for g in self.state.groups if g is not own)))

    def restore(self, number: int) -> None:
        """Put a group back to where it is at rest."""
        with self._lock:
            start = self.mesh.V[self.state.group(number).vertices]
            self._push(self.state.changed(number, start=start, motion=Motion.none(), turn=None))
            self._jumped = True

    def alter(self, number: int, **fields: Any) -> None:
        """Give a group another ``kind``, ``weight`` (inf for hard) or ``name``.

        Raises
        ------
        InputError
            See :class:`sshade.edit.state.Group`.
        """
        with self._lock:
            before, shape = self.shown, self.state.shape
            self._push(self.state.changed(number, **fields))
            if set(fields) == {"name"} and shape is not None:  # it is the same shape by another name
                self.history.settle(self.state, shape)
                self.shown = before

    def set_up(self, settings: Settings) -> None:
        """Follow by another method, or with other constraints."""
        with self._lock:
            if settings != self.state.settings:
                self._push(replace(self.state, settings=settings))
                self._jumped = True

    def open(self, content: bytes, name: str) -> None:
        """Take the groups of a handle file instead of those there are.

        Parameters
        ----------
        content : bytes
            Of this project's JSON.
        name : str
            For messages.

        Raises
        ------
        InputError
            See :func:`sshade.io.handles.read_handles`.
        """
        with self._lock:
            self._take(self.document.received_groups(content, name, first=self._number))

    def undo(self) -> None:
        """Go a step back, if there is one."""
        self._go(-1)

    def redo(self) -> None:
        """Go the step again that was undone last."""
        self._go(1)

    # Shapes.

    def drag(self, number: int, motion: Motion) -> np.ndarray:
        """Show the mesh with a group moved, from where it was released last.

        Parameters
        ----------
        number : int
            Of a moving group.
        motion : Motion

        Returns
        -------
        (n, 3) float64
            The positions that are :attr:`shown` now.

        Raises
        ------
        InputError
            When there is no such group, it is static, or the mesh cannot be bound with these handles.
        """
        with self._following:
            with self._lock:
                groups, state = self.state.groups, self.state.moved(number, motion)
                revision, shape = self._advance(), self.shown
            if self._dragged is None or self._dragged[0] is not groups:
                self._dragged = groups, state.handles(self.mesh).with_portions(self.mesh)
            handles = self._dragged[1].at(*state.aims())
            if self._jumped:
                self._follower.forget()
                self._jumped = False
            shape = np.array(shape, order="C")
            on = int(state.group(number).vertices[0])
            self._follower.follow(handles, on, state.settings, shape)
            shape.setflags(write=False)
            with self._lock:
                if self._revision == revision:
                    self.shown = shape
        return shape

    def release(self, number: int, motion: Motion) -> None:
        """End a drag: the group stays there.

        Raises
        ------
        InputError
            When there is no such group, or it is static.
        """
        with self._lock:
            self._push(self.state.moved(number, motion))

    def settle(self, progress: Progress = silent) -> None:
        """Compute the shape for the handles, as ``sshade deform`` does, unless it is known, and show it.

        Parameters
        ----------
        progress : Progress

        Raises
        ------
        InputError
            Where the method refuses them.
        Superseded
            When the handles changed meanwhile.
        """
        with self._lock:
            state, revision = self.state, self._revision

        def watched(stage: str, done: int, total: int, note: str = "") -> None:
            if self._revision != revision:
                raise Superseded
            progress(stage, done, total, note)

        V = state.shape
        if V is None:
            V = settled(self.document.task(state), state.settings, progress=watched).vertices
        with self._lock:
            if self._revision != revision:
                raise Superseded
            self.history.settle(state, V)
            self.shown = V

    # Files.

    def save_handles(self, name: str, *, over: bool = False) -> Path:
        """Write the groups as a handle file; return where.

        Raises
        ------
        InputError
            See :meth:`sshade.edit.saving.Outputs.choose`; when there are no groups.
        """
        with self._lock:
            path = self.document.write_handles(self.state, name, over=over)
            self._saved = self.state.groups
        return path

    def save_mesh(
        self, name: str, *, over: bool = False, progress: Progress = silent
    ) -> tuple[Path, tuple[str, ...]]:
        """Write the mesh as the handles deform it; return where, and what of its file that format has not.

        Raises
        ------
        InputError
            See :meth:`sshade.edit.saving.Outputs.choose`; where the method refuses the handles.
        Superseded
            When the handles changed meanwhile.
        """
        path = self.document.outputs.choose("mesh", name, over=over)
        self.settle(progress)
        return path, self.document.write_mesh(self.shown, path)

    # Within.

    def _take(self, groups: tuple[Group, ...]) -> None:
        """Groups of a file instead of those there are."""
        state = replace(self.state, groups=groups)
        self.mesh.require_handles(state.handles(self.mesh).index, everywhere=False)
        self._number += len(groups)
        self._push(state)
        self._saved, self._jumped = groups, True

    def _push(self, state: State) -> None:
        """Make a step; its shape is open unless groups and method stay, or all is at rest."""
        if not state.same_shape(self.state):
            state = replace(state, shape=None if state.displaced(self.mesh) else self.mesh.V)
            self._advance()
            if state.shape is not None:
                self.shown = state.shape
        self.history.push(state)

    def _go(self, step: int) -> None:
        with self._lock:
            before = self.state
            self.history.go(step)
            if self.state.same_shape(before):
                return
            self._advance()
            if self.state.shape is not None:
                self.shown = self.state.shape
        self._jumped = True

    def _advance(self) -> int:
        """Let everything that is being computed know that it is out of date."""
        with self._lock:
            self._revision += 1
            return self._revision

    def _prepare(self, group: Group) -> None:
        """Bind the mesh with the present handles while the person looks for the gizmo."""
        with self._lock:
            handles, settings = self.state.handles(self.mesh), self.state.settings

        def prepare() -> None:
            with self._following, suppress(InputError, FloatingPointError):  # the drag itself tells it
                shared = handles.with_portions(self.mesh)
                self._follower.prepare(shared, int(group.vertices[0]), settings)

        Thread(target=prepare, daemon=True).start()
