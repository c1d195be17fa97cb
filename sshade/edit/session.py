"""A session of the editor: one method for each action of the user, without a browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.edit.document import Document
from sshade.edit.grouping import Grouping
from sshade.edit.groups import Group
from sshade.edit.selection import selected
from sshade.edit.state import History, Settings


class Session(Grouping):
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
    refuse_unconstrained : bool
        See :class:`sshade.DeformationTask`.
    **options
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
        refuse_unconstrained: bool = False,
        **options: Any,
    ) -> None:
        options["refuse"] = refuse_unconstrained
        super().__init__(Document(path, output=output, handles=handles_output, **options), settings)
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
        """
        with self._lock:
            new = selected(self.mesh, self.state.selection, np.asarray(vertices), how)
            if not np.array_equal(new, self.state.selection):
                self._push(replace(self.state, selection=new))

    def end(self, patience: float) -> None:
        """Wait for the current computation, up to some seconds, and let no further computation begin.

        A thread that returns from compiled code while the interpreter ends would abort the process. The
        recovery file stays if there are unsaved groups.
        """
        if not self.is_unsaved:
            self.recovery.remove()
        self._following.acquire(timeout=patience)

    def set_up(self, settings: Settings) -> None:
        """Change the method or the constraints."""
        with self._lock:
            if settings != self.state.settings:
                self._push(replace(self.state, settings=settings))
                self._jumped = True

    def recover(self) -> None:
        """Restore groups, settings and selection from the first recovery file that is offered.

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
            self._count_as_saved()
        return path, ()

    # Helpers.

    def _count_as_saved(self) -> None:
        """Count the groups and the settings as saved."""
        self._saved = replace(self.state, shape=None)
        self._keep()

    def _take(self, groups: tuple[Group, ...]) -> None:
        """Replace all groups by the groups of a file."""
        state = replace(self.state, groups=groups)
        self.mesh.require_handles(state.handles(self.mesh).index, everywhere=False)
        self._number += len(groups)
        self._saved, self._jumped = replace(state, selection=self._saved.selection, shape=None), True
        self._push(state)
