"""A session of the editor: one method for each action of the user, without a browser."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from sshade.edit.document import Document
from sshade.edit.groups import LONGEST, Group, Kind, frame, normal
from sshade.edit.mirror import mirrored
from sshade.edit.selection import near, selected
from sshade.edit.state import History, Settings
from sshade.edit.work import Work
from sshade.errors import InputError
from sshade.progress import Progress, silent

#: Greatest distance from rest at which a new static group counts as at rest, as a fraction of the diagonal.
AT_REST = 1e-6


class Session(Work):
    """A mesh, a selection of vertices, handle groups, and their history.

    See :class:`sshade.edit.work.Work` for undo, drags and shapes.

    Parameters
    ----------
    path : path
        Any mesh file that ``sshade deform`` takes.
    handles : path, optional
        Handle file with the first groups.
    output, handles_output : path, optional
        See :class:`sshade.edit.document.Document`.
    settings : Settings
    carry_unconstrained : bool
        See :class:`sshade.DeformationTask`.
    **welding
        ``weld`` and ``repair`` of :class:`sshade.edit.document.Document`.

    Raises
    ------
    InputError
        When a file cannot be read or written.
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
        **welding: Any,
    ) -> None:
        welding["carry"] = carry_unconstrained
        super().__init__(Document(path, output=output, handles=handles_output, **welding), settings)
        self._number = 1
        if handles is not None:
            self._take(self.document.read_groups(handles, first=1))
            self.history = History(self.state)

    # Actions that can be undone.

    def select(self, vertices: np.ndarray, how: str) -> None:
        """Change the selection.

        Parameters
        ----------
        vertices : (k,) int
        how : str
            See :func:`sshade.edit.selection.selected`.

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
        """Select everything within a distance of the selection; see :func:`sshade.edit.selection.near`."""
        with self._lock:
            self.select(np.flatnonzero(near(self.mesh, self.state.selection, distance)), "replace")

    def limit(self, number: int, distance: float) -> int:
        """Fix everything farther than a distance from a group, except other groups; return the new number.

        The surface in between then bends, so that a move falls off within the distance.

        Raises
        ------
        InputError
            See :func:`sshade.edit.selection.near`; also when no vertex is so far away.
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
            See :func:`sshade.edit.mirror.mirrored`.
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
            See :class:`sshade.edit.groups.Group`.
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
        """Return the normal (3,) of a group; see :func:`sshade.edit.groups.normal`."""
        return normal(self.mesh, self.state.group(number))

    def frame(self, number: int) -> np.ndarray:
        """Return the local axes (3, 3) of a group; see :func:`sshade.edit.groups.frame`."""
        return frame(self.mesh, self.state.group(number))

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
            self._saved = self.state.groups, self.state.settings
            self._saved_selection = self.state.selection
            self._keep()
        return path, ()

    # Helpers.

    def _take(self, groups: tuple[Group, ...]) -> None:
        """Replace all groups by the groups of a file."""
        state = replace(self.state, groups=groups)
        self.mesh.require_handles(state.handles(self.mesh).index, everywhere=False)
        self._number += len(groups)
        self._saved, self._jumped = (groups, state.settings), True
        self._push(state)
