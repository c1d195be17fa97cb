"""A session of the editor: one method for each action of the user, without a browser."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from threading import RLock, Thread
from typing import Any

import numpy as np

from sshade.edit.document import Document
from sshade.edit.follower import Follower, converged
from sshade.edit.recovery import Recovery
from sshade.edit.state import (
    LONGEST,
    Group,
    History,
    Kind,
    Motion,
    Settings,
    State,
    mirrored,
    near,
    selected,
)
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.progress import Progress, silent

#: Greatest distance from rest at which a new static group counts as at rest, as a fraction of the diagonal.
AT_REST = 1e-6


class Superseded(Exception):
    """The handles changed during a computation, whose result is therefore out of date."""


class Session:
    """A mesh, a selection of vertices, handle groups, and their history.

    Every method may be called from any thread. :meth:`undo` reverts all changes, except for files that were
    saved. A :meth:`drag` counts as a change when :meth:`release` ends it.

    Parameters
    ----------
    path : path
        Any mesh file that ``sshade deform`` takes.
    handles : path or Handles, optional
        Handle file with the first groups, or handles at vertices of the file.
    output, handles_output : path, optional
        See :class:`sshade.edit.document.Document`.
    settings : Settings
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.
    **options
        ``file``, ``weld`` and ``repair`` of :class:`sshade.edit.document.Document`.

    Attributes
    ----------
    document : Document
    history : History
    mesh : Mesh
        The surface in the file that can be deformed.
    recovery : Recovery
        Keeps the unsaved work in a file beside the handles.
    version : int
        Increases with each change that a page shows, except for steps of a drag.
    trouble : str
        Why the recovery file could not be written; empty if it was.
    shown : (n, 3) float64
        Latest positions of the mesh: of a drag, or converged.

    Raises
    ------
    InputError
        When a file cannot be read or written.
    """

    def __init__(
        self,
        path: Path,
        *,
        handles: Path | Handles | None = None,
        output: Path | None = None,
        handles_output: Path | None = None,
        settings: Settings = Settings(),  # noqa: B008  (immutable)
        carry_unconstrained: bool = False,
        **options: Any,
    ) -> None:
        options["carry"] = carry_unconstrained
        self.document = Document(path, output=output, handles=handles_output, **options)
        self.mesh = mesh = self.document.mesh
        self.recovery = Recovery(self.document.outputs["handles"].parent, self.document.name, mesh)
        self.trouble = ""
        self.version = 0
        self.shown = mesh.V
        self.history = History(State(settings=settings, shape=mesh.V))
        self._revision, self._number = 0, 1
        self._saved: tuple[tuple[Group, ...], Settings] = (), settings
        self._saved_selection = self.state.selection
        self._lock, self._following, self._settling = RLock(), RLock(), RLock()
        self._follower = Follower(mesh)
        #: Whether the handles moved since the last step of a drag.
        self._jumped = False
        #: Groups and handles of the last step of a drag.
        self._dragged: tuple[tuple[Group, ...], Handles] | None = None
        if handles is not None:
            if isinstance(handles, Handles):
                self._take(self.document.groups_of(handles))
            else:
                self._take(self.document.read_groups(handles, first=1))
            self.history = History(self.state)

    @property
    def state(self) -> State:
        """Current state."""
        return self.history.state

    @property
    def is_converged(self) -> bool:
        """Whether the converged shape of the current handles is known and shown."""
        return self.state.shape is self.shown

    @property
    def is_unsaved(self) -> bool:
        """Whether there are groups that were not saved, or not with the current settings."""
        groups, settings = self._saved
        return bool(self.state.groups) and (
            self.state.groups is not groups or self.state.settings != settings
        )

    # Actions that can be undone.

    def select(self, vertices: np.ndarray, how: str) -> None:
        """Change the selection.

        Parameters
        ----------
        vertices : (k,) int
        how : str
            See :func:`sshade.edit.state.selected`.

        Raises
        ------
        InputError
            When a vertex is out of range, or `how` is another word.
        """
        with self._lock:
            new = selected(self.mesh, self.state.selection, np.asarray(vertices), how)
            if not np.array_equal(new, self.state.selection):
                self._push(replace(self.state, selection=new))

    def mark(self, kind: Kind) -> int:
        """Create a group of the selected vertices at their current positions; return its number.

        The vertices leave the groups that contained them.

        Raises
        ------
        InputError
            When no vertex is selected, or on another kind.
        """
        with self._lock:
            vertices = self.state.selection
            if len(vertices) == 0:
                raise InputError("no vertex is picked; pick some by click, brush, rectangle or lasso")
            number = self._mark(kind, vertices)
            handles, settings = self.state.handles(self.mesh), self.state.settings

        def prepare() -> None:
            """Bind the mesh before the user begins to drag."""
            with self._following, suppress(InputError, FloatingPointError):  # the drag reports the error
                self._follower.prepare(handles.with_portions(self.mesh), int(vertices[0]), settings)

        Thread(target=prepare, daemon=True).start()
        return number

    def _mark(self, kind: Kind, vertices: np.ndarray, name: str = "") -> int:
        """Create a group of vertices at their current positions; return its number."""
        target, rest = self.shown[vertices], self.mesh.V[vertices]
        if kind == "static" and np.abs(target - rest).max() <= AT_REST * self.mesh.diagonal:
            target = rest
        number, self._number = self._number, self._number + 1
        self._push(self.state.marked(Group(number, name or f"group {number}", kind, vertices, target)))
        return number

    def reach(self, distance: float) -> None:
        """Select everything within a distance of the selection; see :func:`sshade.edit.state.near`."""
        with self._lock:
            self.select(np.flatnonzero(near(self.mesh, self.state.selection, distance)), "replace")

    def limit(self, number: int, distance: float) -> int:
        """Fix everything farther than a distance from a group, except other groups; return the new number.

        The surface in between then bends, so that a move falls off within the distance.

        Raises
        ------
        InputError
            See :func:`sshade.edit.state.near`; also when no vertex is so far away.
        """
        with self._lock:
            group = self.state.group(number)
            far = ~near(self.mesh, group.vertices, distance)
            for other in self.state.groups:
                far[other.vertices] = False
            if not far.any():
                raise InputError(f"no free vertex is farther than {distance:g} from {group.name}")
            return self._mark("static", np.flatnonzero(far), f"beyond {group.name}"[:LONGEST])

    def mirror(self, number: int, axis: int) -> int:
        """Create the mirrored group of a group, or update it; return its number.

        Raises
        ------
        InputError
            See :func:`sshade.edit.state.mirrored`.
        """
        with self._lock:
            new = mirrored(self.mesh, self.state.group(number), axis, number=self._number)
            self._number += 1
            self._push(replace(self.state.marked(new), selection=self.state.selection))
            self._jumped = True
        return new.number

    def end(self, patience: float) -> None:
        """Wait for the current computation, up to some seconds, and let no further computation begin.

        A thread that returns from compiled code while the interpreter ends would abort the process. The
        recovery file stays if there are unsaved groups.
        """
        self.recovery.end(keep=self.is_unsaved)
        self._following.acquire(timeout=patience)

    def remove(self, number: int) -> None:
        """Remove a group; its vertices become unconstrained."""
        with self._lock:
            group = self.state.group(number)
            self._push(replace(self.state, groups=tuple(g for g in self.state.groups if g is not group)))

    def restore(self, number: int) -> None:
        """Move a group back to its rest positions."""
        with self._lock:
            rest = self.mesh.V[self.state.group(number).vertices]
            self._push(self.state.changed(number, target=rest, turn=None, is_prescribed=False))
            self._jumped = True

    def alter(self, number: int, **fields: Any) -> None:
        """Change the ``kind``, ``weight`` (inf for hard), ``slide`` or ``name`` of a group.

        Another slide begins where the group is.

        Raises
        ------
        InputError
            See :class:`sshade.edit.state.Group`.
        """
        with self._lock:
            if "slide" in fields:
                group, slide = self.state.group(number), fields["slide"]
                fields["target"] = self.state.place(group)
                if slide is not None and slide.free:
                    fields = {**fields, "target": self.mesh.V[group.vertices], "weight": inf}
            self._push(self.state.changed(number, **fields))
            self._jumped |= "slide" in fields

    def normal(self, number: int) -> np.ndarray:
        """Return the mean normal (3,) of the rest shape at a group, of any length; z if the mean is 0."""
        own = np.isin(self.mesh.F, self.state.group(number).vertices).any(axis=1)
        a, b, c = self.mesh.V[self.mesh.F[own]].transpose(1, 0, 2)
        mean = np.cross(b - a, c - a).sum(axis=0)
        return mean if mean.any() else np.array([0.0, 0.0, 1.0])

    def frame(self, number: int) -> np.ndarray:
        """Return the local axes of a group, columns (3, 3), which turn with it: z is its normal."""
        group, z = self.state.group(number), self.normal(number)
        z = z / np.linalg.norm(z)
        rest = self.mesh.V[group.vertices] - self.mesh.V[group.vertices].mean(axis=0)
        flat = rest - np.outer(rest @ z, z)
        x = np.linalg.svd(flat, full_matrices=False)[2][0] if len(flat) > 1 and flat.any() else np.zeros(3)
        if np.linalg.norm(x - z * (x @ z)) < 0.5:  # a single vertex, or vertices along the normal
            x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - z * (x @ z)
        x = x / np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z], axis=1)
        return R if group.turn is None else group.turn @ R

    def set_up(self, settings: Settings) -> None:
        """Change the method or the constraints."""
        with self._lock:
            if settings != self.state.settings:
                self._push(replace(self.state, settings=settings))
                self._jumped = True

    def open(self, content: bytes, name: str) -> None:
        """Replace all groups by the groups of a handle file.

        Parameters
        ----------
        content : bytes
            Handle file in this project's JSON.
        name : str
            Name of the file, for messages.

        Raises
        ------
        InputError
            See :func:`sshade.io.handles.read_handles`.
        """
        with self._lock:
            self._take(self.document.received_groups(content, name, first=self._number))

    def recover(self, path: Path | None = None) -> None:
        """Restore groups, settings and selection from a recovery file, by default from the first offer.

        An offered file is removed after the recovery file of this session was written.

        Raises
        ------
        InputError
            When there is no offer, or the file is unreadable or belongs to another mesh.
        """
        with self._lock:
            path = self._offered() if path is None else path
            found = self.recovery.read(path, first=self._number)
            self._number += len(found.groups)
            self._push(found)
            self._jumped = True
            if not self.trouble:
                self.recovery.withdraw(path)
            self.version += 1

    def discard(self) -> None:
        """Remove the first recovery file that is offered; raise InputError when there is none."""
        with self._lock:
            self.recovery.withdraw(self._offered())
            self.version += 1

    def _offered(self) -> Path:
        if not self.recovery.offers:
            raise InputError("there is nothing to recover")
        return self.recovery.offers[0].path

    def undo(self) -> None:
        """Return to the previous state, if there is one."""
        self._go(-1)

    def redo(self) -> None:
        """Revert the last undo."""
        self._go(1)

    # Shapes.

    def drag(self, number: int, motion: Motion) -> np.ndarray:
        """Show the mesh with a group moved from the place of its last release.

        Parameters
        ----------
        number : int
            Number of a moving group.
        motion : Motion

        Returns
        -------
        (n, 3) float64
            Positions of the mesh, which :attr:`shown` holds as well.

        Raises
        ------
        InputError
            When no group has the number, the group is static, or the mesh cannot be bound with these handles.
        """
        with self._following:
            with self._lock:
                groups, state = self.state.groups, self.state.moved(number, motion)
                self._revision += 1
                revision, shape = self._revision, self.shown
            if self._dragged is None or self._dragged[0] is not groups:
                self._dragged = groups, state.handles(self.mesh).with_portions(self.mesh)
            handles = self._dragged[1].at(*state.aims())
            if self._jumped:
                self._follower.forget()
                self._jumped = False
            shape = np.array(shape, order="C")
            self._follower.follow(handles, int(state.group(number).vertices[0]), state.settings, shape)
            shape.setflags(write=False)
            with self._lock:
                if self._revision == revision:
                    self.shown = shape
        return shape

    def release(self, number: int, motion: Motion) -> None:
        """End a drag; the group stays at its place.

        Raises
        ------
        InputError
            When there is no such group, or it is static.
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

            V = state.shape
            if V is None:
                V = converged(self.document.task(state), state.settings, progress=watched).vertices
            with self._lock:
                if self._revision != revision:
                    raise Superseded
                self.history.store_shape(state, V)
                self.version += state.shape is None
                self.shown = V

    # Files.

    def save(
        self, content: str, name: str, *, over: bool = False, progress: Progress = silent
    ) -> tuple[Path, tuple[str, ...]]:
        """Write the groups as a handle file, or the deformed mesh.

        Parameters
        ----------
        content : {"handles", "mesh"}
        name, over
            See :meth:`sshade.edit.document.Document.choose`.
        progress : Progress

        Returns
        -------
        path : path
        lost : tuple of str
            Contents of the mesh file that the format of the new file cannot hold.

        Raises
        ------
        InputError
            See :meth:`sshade.edit.document.Document.choose`; also when there are no groups to write, or the
            method refuses them.
        Superseded
            When the handles changed during the computation.
        """
        path = self.document.choose(content, name, over=over)
        if content == "mesh":
            self.settle(progress)
            return path, self.document.write_mesh(self.shown, path)
        with self._lock:
            self.document.write_handles(self.state, path)
            self._count_as_saved()
        return path, ()

    def hand_over(self) -> Handles:
        """Return the groups as handles at vertices of the file; they then count as saved.

        Raises
        ------
        InputError
            When there are no groups.
        """
        with self._lock:
            handles = self.document.all_handles(self.state)
            self._count_as_saved()
        return handles

    # Helpers.

    def _count_as_saved(self) -> None:
        self._saved = self.state.groups, self.state.settings
        self._saved_selection = self.state.selection
        self._keep()

    def _take(self, groups: tuple[Group, ...]) -> None:
        """Replace all groups by the groups of a file."""
        state = replace(self.state, groups=groups)
        self.mesh.require_handles(state.handles(self.mesh).index, everywhere=False)
        self._number += len(groups)
        self._saved, self._jumped = (groups, state.settings), True
        self._push(state)

    def _push(self, state: State) -> None:
        """Append a state. Its shape is unknown unless groups and settings stay, or all groups are at rest."""
        before = self.state
        if not state.same_shape(before):
            state = replace(state, shape=None if state.displaced(self.mesh) else self.mesh.V)
        self.history.push(state)
        self._advance(before)
        self._keep()

    def _keep(self) -> None:
        """Write the recovery file, or remove it if everything is saved."""
        picked = self.state.selection
        self.version += 1
        self.trouble = ""
        if not self.is_unsaved and (len(picked) == 0 or picked is self._saved_selection):
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

    def _advance(self, before: State) -> bool:
        """Return whether groups or settings differ from `before`; then computations are out of date."""
        if self.state.same_shape(before):
            return False
        self._revision += 1
        if self.state.shape is not None:
            self.shown = self.state.shape
        return True
