"""A session of the editor: one method for each action of the user, without a browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sshade.edit.document import Document, Given
from sshade.edit.grouping import Grouping
from sshade.edit.groups import Group
from sshade.edit.keys import LONGEST, Key, posed
from sshade.edit.selection import TAKING, near, require_vertices, selected
from sshade.edit.state import History, Settings
from sshade.errors import InputError
from sshade.handles import Handles
from sshade.progress import Progress, silent

#: Seconds between two shown poses from which the second does not continue the first.
JUMP = 0.5


class Session(Grouping):
    """A mesh, a selection of vertices, handle groups, and their history.

    See :class:`sshade.edit.work.Work` for undo, drags and shapes.

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
        super().__init__(Document(path, output=output, handles=handles_output, **options), settings)
        #: Time of the pose that was shown last.
        self._sought = 0.0
        if handles is not None:
            if isinstance(handles, Handles):
                self._take(Given(self.document.groups_of(handles), (), ()))
            else:
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
            vertices = np.asarray(vertices)
            if self.symmetry is not None and len(vertices) and how in TAKING:
                require_vertices(self.mesh, vertices)
                vertices = np.union1d(vertices, self._images(vertices, self.symmetry))
            new = selected(self.mesh, self.state.selection, vertices, how)
            if not np.array_equal(new, self.state.selection):
                self._push(replace(self.state, selection=new))

    def reach(self, distance: float) -> None:
        """Select everything within a distance of the selection; see :func:`sshade.edit.selection.near`."""
        with self._lock:
            self.select(np.flatnonzero(near(self.mesh, self.state.selection, distance)), "replace")

    def end(self, patience: float) -> None:
        """Wait for the current computation, up to some seconds, and let no further computation begin.

        A thread that returns from compiled code while the interpreter ends would abort the process. The
        recovery file stays if there are unsaved groups.
        """
        self.recovery.end(keep=self.is_unsaved)
        self._following.acquire(timeout=patience)

    def set_up(self, settings: Settings) -> None:
        """Change the method or the constraints."""
        with self._lock:
            if settings != self.state.settings:
                self._push(replace(self.state, settings=settings, unfaded=None))
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

    # Animation: keys, and the poses between them.

    def key(self, time: float) -> None:
        """Store the current pose at a time, and replace a key that is there.

        Raises
        ------
        InputError
            When there are no groups, or the time is negative or too late.
        """
        if not 0 <= time <= LONGEST:
            raise InputError(f"a time is a number of seconds from 0 to {LONGEST:g}, not {time:g}")
        with self._lock:
            self._require_groups()
            others = [key for key in self.state.keys if key.time != time]
            keys = sorted([*others, Key(time, self.state.groups)], key=lambda key: key.time)
            self._push(replace(self.state, keys=tuple(keys)))

    def unkey(self, time: float) -> None:
        """Remove the key at a time; raise InputError when there is none."""
        with self._lock:
            keys = tuple(key for key in self.state.keys if key.time != time)
            if len(keys) == len(self.state.keys):
                raise InputError(f"there is no key at {time:g} s")
            self._push(replace(self.state, keys=keys))

    def seek(self, time: float) -> np.ndarray:
        """Show the mesh in the pose of a time, as a drag does, and return its positions (n, 3).

        Raises
        ------
        InputError
            When there are no groups or keys, or the mesh cannot be bound.
        """
        self._require_groups()
        moving = [group.number for group in self.state.groups if not group.link]
        self._jumped |= abs(time - self._sought) > JUMP
        self._sought = time
        return self._follow(lambda: replace(self.state, groups=self._posed(time)), moving)

    def pose(self, time: float) -> None:
        """Move the groups to the pose of a time; raise InputError when there are no groups or keys."""
        with self._lock:
            self._require_groups()
            self._push(replace(self.state, groups=self._posed(time)))
            self._jumped = True

    def _posed(self, time: float) -> tuple[Group, ...]:
        if not self.state.keys:
            raise InputError("there is no key; store a pose first")
        return posed(self.mesh, self.state.groups, self.state.keys, time)

    def _require_groups(self) -> None:
        if not self.state.groups:
            raise InputError("there are no groups to animate; pick vertices and make them movable")

    # Files.

    def save(
        self,
        content: str,
        name: str,
        *,
        over: bool = False,
        rate: float = 0.0,
        progress: Progress = silent,
    ) -> tuple[Path, tuple[str, ...]]:
        """Write the groups as a handle file, the deformed mesh, or the keys as an animation of handles.

        Parameters
        ----------
        content : {"handles", "mesh", "animation"}
        name, over
            See :meth:`sshade.edit.document.Document.choose`.
        rate : float
            Frames per second of an animation between keys; 0 writes the keys alone.
        progress : Progress

        Returns
        -------
        path : path
        lost : tuple of str
            Contents of the mesh file that the format of the new file cannot hold.

        Raises
        ------
        InputError
            See :meth:`sshade.edit.document.Document.choose`; also when there are no groups or keys to write,
            or the method refuses the groups.
        Superseded
            When the handles changed during the computation.
        """
        path = self.document.choose(content, name, over=over)
        if content == "mesh":
            self.settle(progress)
            return path, self.document.write_mesh(self.shown, path)
        with self._lock:
            if content == "animation":
                self.document.write_animation(self.state, path, rate)
                self._count_as_saved(self.state.keys)
            else:
                self.document.write_handles(self.state, path)
                self._count_as_saved(self._saved.keys)
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
            self._count_as_saved(self._saved.keys)
        return handles

    # Helpers.

    def _count_as_saved(self, keys: tuple[Key, ...]) -> None:
        """Count the groups, the settings and the keys as saved."""
        self._saved = replace(self.state, keys=keys, shape=None)
        self._keep()

    def _take(self, given: Given) -> None:
        """Replace all groups and keys by those of a file. Constraints that it left out are left out."""
        groups, keys, unconstrained = given
        method, volume, area = self.state.settings
        kept = volume and "volume" not in unconstrained, area and "area" not in unconstrained
        settings = Settings(method, *kept)
        state = replace(self.state, groups=groups, keys=keys, settings=settings)
        self.mesh.require_handles(state.handles(self.mesh).index, everywhere=False)
        self._number += len(groups)
        self._saved, self._jumped = replace(state, selection=self._saved.selection, shape=None), True
        self._push(state)
