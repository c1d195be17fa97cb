"""Actions on the groups of a session."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from threading import Thread
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.edit.document import Document
from sshade.edit.groups import LONGEST, Group, Kind
from sshade.edit.selection import near
from sshade.edit.state import Settings
from sshade.edit.work import Work

#: Greatest distance from rest at which a new fixed group counts as at rest, as a fraction of the diagonal.
AT_REST = 1e-6


class Grouping(Work):
    """Groups of a document: made of the selection, and changed.

    Parameters
    ----------
    document, settings
        See :class:`sshade.edit.work.Work`.
    """

    def __init__(self, document: Document, settings: Settings) -> None:
        super().__init__(document, settings)
        self._number = 1

    def mark(self, kind: Kind) -> int:
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
            with self._following, suppress(InputError, FloatingPointError):  # the drag reports the error
                handles = self._dragged_from(state).handles
                self._follower.prepare(handles, int(vertices[0]), state.settings)

        Thread(target=prepare, daemon=True).start()
        return number

    def _mark(self, kind: Kind, vertices: np.ndarray, name: str = "") -> int:
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
