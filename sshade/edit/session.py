"""A session of the editor: one method for each action of the user, without a browser."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.edit.document import Document
from sshade.edit.groups import LONGEST, Group, GroupKind
from sshade.edit.selection import near, selected
from sshade.edit.state import EditState
from sshade.edit.workspace import Workspace

#: Greatest distance from rest at which a new fixed group counts as at rest, as a fraction of the diagonal.
AT_REST = 1e-6


class Session(Workspace):
    """A mesh, a selection of vertices, handle groups, and their history.

    See :class:`sshade.edit.workspace.Workspace` for undo, drags and shapes.

    Parameters
    ----------
    document : Document
    method : {"fast", "fine", "paper"}
    handles : path, optional
        Handle file with the first groups.
    options : mapping
        Options that differ from the method's.

    Raises
    ------
    InputError
        When the handle file cannot be read.
    """

    def __init__(
        self,
        document: Document,
        method: str = "fast",
        handles: Path | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        groups = () if handles is None else document.read_groups(handles)
        super().__init__(document, EditState(groups=groups, method=method, options=options or {}))
        self._number = 1 + len(groups)

    def select(self, vertices: np.ndarray, how: str) -> None:
        """Change the selection.

        Parameters
        ----------
        vertices : (k,) int
        how : str
            See :func:`sshade.edit.selection.selected`.
        """
        with self._lock:
            new = selected(self.mesh, self.state.selection, np.asarray(vertices), how)
            if not np.array_equal(new, self.state.selection):
                self._push(replace(self.state, selection=new))

    def mark(self, kind: GroupKind) -> int:
        """Create a group of the selected vertices at their current positions; return its number.

        The vertices leave the groups that contained them.

        Raises
        ------
        InputError
            When no vertex is selected.
        """
        with self._lock:
            vertices = self.state.selection
            if len(vertices) == 0:
                raise InputError("no vertex is picked; pick some by click, brush, rectangle or lasso")
            number = self._mark(kind, vertices)
            state = self.state

        def prepare() -> None:
            """Bind the mesh before the user begins to drag."""
            with suppress(InputError, FloatingPointError):  # the drag reports the error
                self.bound(state)

        Thread(target=prepare, daemon=True).start()
        return number

    def _mark(self, kind: GroupKind, vertices: np.ndarray, name: str = "") -> int:
        """Create a group of vertices at their current positions; return its number."""
        target, rest = self.shown[vertices], self.mesh.V[vertices]
        if kind == "fixed" and np.abs(target - rest).max() <= AT_REST * self.mesh.diagonal:
            target = rest
        number, self._number = self._number, self._number + 1
        name = (name or f"group {number}")[:LONGEST]
        self._push(self.state.marked(Group(number, name, kind, vertices, target)))
        return number

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
            return self._mark("fixed", np.flatnonzero(far), f"beyond {group.name}")

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
        """Change the ``kind``, ``weight`` (inf for hard) or ``name`` of a group.

        Raises
        ------
        InputError
            See :class:`sshade.edit.groups.Group`.
        """
        with self._lock:
            self._push(self.state.changed(number, **fields))

    def set_up(self, method: str, *, joints: float | None = None) -> None:
        """Change the method, and its option `joints`; raise InputError on a value out of its range."""
        with self._lock:
            options = self.state.options if joints is None else {**self.state.options, "joints": joints}
            state = replace(self.state, method=method, options=options)
            state.resolved  # noqa: B018 - checks the values
            if state.made != self.state.made:
                self._push(state)
                self._jumped = True

    def recover(self) -> None:
        """Restore groups, options and selection from the first recovery file that is offered.

        The file is removed after the recovery file of this session was written.

        Raises
        ------
        InputError
            When there is no offer, or the file is unreadable or belongs to another mesh.
        """
        with self._lock:
            path = self._offered()
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
            method refuses the groups.
        Superseded
            When the handles changed during the computation.
        """
        path = self.document.choose(content, name, over=over)
        if content == "mesh":
            self.settle(progress)
            return path, self.document.write_mesh(self.shown, path)
        with self._lock:
            self.document.write_handles(self.state, path)
            self._saved = replace(self.state, shape=None)
            self._keep()
        return path, ()

    def end(self, patience: float) -> None:
        """Wait for the current computation, up to some seconds, and let no further computation begin.

        A thread that returns from compiled code while the interpreter ends would abort the process. The
        recovery file stays if there are unsaved groups.
        """
        if not self.is_unsaved:
            self.recovery.remove()
        self._dragging.acquire(timeout=patience)
