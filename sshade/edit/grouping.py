"""Actions on the groups of a session."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import inf
from threading import Thread
from typing import Any

import numpy as np

from sshade.edit.document import Document
from sshade.edit.groups import LONGEST, Group, Kind, frame, normal
from sshade.edit.links import OVERLAP, Link, mirrored_slide, mirrored_vertices, sides
from sshade.edit.selection import near
from sshade.edit.state import Settings
from sshade.edit.work import Work
from sshade.errors import InputError

#: Greatest distance from rest at which a new static group counts as at rest, as a fraction of the diagonal.
AT_REST = 1e-6


class Grouping(Work):
    """Groups of a document: made of the selection, changed, and following each other.

    Parameters
    ----------
    document, settings
        See :class:`sshade.edit.work.Work`.

    Attributes
    ----------
    symmetry : int or None
        Coordinate across which picks and new movable groups are mirrored.
    """

    def __init__(self, document: Document, settings: Settings) -> None:
        super().__init__(document, settings)
        self._number = 1
        self.symmetry: int | None = None
        self._tree: Any = None

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
            number = self._mark_both(kind, vertices)
            vertices = self.state.group(number).vertices
            handles, settings = self.state.handles(self.mesh), self.state.settings

        def prepare() -> None:
            """Bind the mesh before the user begins to drag."""
            with self._following, suppress(InputError, FloatingPointError):  # the drag reports the error
                self._follower.prepare(handles.with_portions(self.mesh), int(vertices[0]), settings)

        Thread(target=prepare, daemon=True).start()
        return number

    def _mark_both(self, kind: Kind, vertices: np.ndarray) -> int:
        """Create a group; with symmetry, a group for each side, and one for pieces across the middle."""
        axis = self.symmetry
        if axis is None or kind == "static":
            return self._mark(kind, vertices)
        above, below, across = sides(self.mesh, vertices, axis)
        if len(above) == 0 or len(below) == 0:
            return self._mark(kind, vertices)
        state = self.state
        if len(across):
            state = state.marked(self._group(kind, across))
        leader = self._group(kind, above)
        image = self._group(kind, below, f"{leader.name} mirrored", link=Link(leader.number, axis))
        self._push(state.marked(leader).marked(image))
        return leader.number

    def _mark(self, kind: Kind, vertices: np.ndarray, name: str = "") -> int:
        """Create a group of vertices at their current positions; return its number."""
        group = self._group(kind, vertices, name)
        self._push(self.state.marked(group))
        return group.number

    def _group(self, kind: Kind, vertices: np.ndarray, name: str = "", **fields: Any) -> Group:
        """Return a new group of vertices at their current positions."""
        target, rest = self.shown[vertices], self.mesh.V[vertices]
        if kind == "static" and np.abs(target - rest).max() <= AT_REST * self.mesh.diagonal:
            target = rest
        number, self._number = self._number, self._number + 1
        return Group(number, (name or f"group {number}")[:LONGEST], kind, vertices, target, **fields)

    def limit(self, number: int, distance: float) -> int:
        """Fix everything farther than a distance from a group and its mirror image; return the new number.

        Other groups stay as they are. The surface in between then bends, so that a move falls off within the
        distance.

        Raises
        ------
        InputError
            See :func:`sshade.edit.selection.near`; also when no vertex is so far away.
        """
        with self._lock:
            group, _ = self.state.led(number)
            images = [one for one in self.state.groups if one.link and one.link.leader == group.number]
            far = np.ones(self.mesh.n, dtype=bool)
            for one in (group, *images):
                far &= ~near(self.mesh, one.vertices, distance)
            for other in self.state.groups:
                far[other.vertices] = False
            if not far.any():
                raise InputError(f"no free vertex is farther than {distance:g} from {group.name}")
            return self._mark("static", np.flatnonzero(far), f"beyond {group.name}")

    def mirror(self, number: int, axis: int) -> int:
        """Create the mirror image of a group, which moves when the group moves; return its number.

        Raises
        ------
        InputError
            When the group follows another group, lies on both sides or slides on a surface from a file; also
            when the opposite side has no vertices within the mean length of an edge.
        """
        with self._lock:
            group = self.state.group(number)
            if group.link is not None:
                raise InputError(f"{group.name} follows another group; mirror that group")
            found = self._images(group.vertices, axis)
            vertices = np.setdiff1d(found, group.vertices)
            if np.isin(found, group.vertices).sum() > OVERLAP * len(found):
                raise InputError(f"{group.name} lies on both sides of the middle; mirror a group of one side")
            if len(vertices) == 0:
                raise InputError(f"the mesh has no vertices on the other side of {group.name}")
            mirrored_slide(group.slide, axis, group.name)
            name = f"{group.name[: LONGEST - 9]} mirrored"
            new = self._group(group.kind, vertices, name, link=Link(number, axis))
            self._push(replace(self.state.marked(new), selection=self.state.selection))
            self._jumped = True
        return new.number

    def _images(self, vertices: np.ndarray, axis: int) -> np.ndarray:
        """Return the mirror images of vertices; see :func:`sshade.edit.links.mirrored_vertices`."""
        from scipy.spatial import cKDTree

        if self._tree is None:
            self._tree = cKDTree(self.mesh.V, balanced_tree=False)
        return mirrored_vertices(self.mesh, vertices, axis, tree=self._tree)

    def unlink(self, number: int) -> None:
        """Let a group stay where it is, and follow no longer."""
        with self._lock:
            self._push(self.state.changed(number, link=None))

    def mirror_picks(self, axis: int | None) -> None:
        """Mirror picking and new movable groups across a coordinate, or not."""
        with self._lock:
            self.symmetry = axis
            self.version += 1

    def remove(self, number: int) -> None:
        """Remove a group; its vertices become unconstrained."""
        with self._lock:
            group = self.state.group(number)
            self._push(replace(self.state, groups=tuple(g for g in self.state.groups if g is not group)))

    def restore(self, number: int) -> None:
        """Move a group and its followers back to their rest positions."""
        with self._lock:
            group, _ = self.state.led(number)
            rest = self.mesh.V[group.vertices]
            self._push(self.state.changed(group.number, target=rest, turn=None, is_prescribed=False))
            self._jumped = True

    def alter(self, number: int, **fields: Any) -> None:
        """Change the ``kind``, ``weight`` (inf for hard), ``slide`` or ``name`` of a group.

        Another slide begins where the group is. A mirror image has the kind, weight and slide of its leader:
        such a change of the image changes the leader.

        Raises
        ------
        InputError
            See :class:`sshade.edit.groups.Group`.
        """
        with self._lock:
            group = self.state.group(number)
            if fields.keys() - {"name"} and group.link is not None:
                if "slide" in fields:
                    fields["slide"] = mirrored_slide(fields["slide"], group.link.axis, group.name)
                group = self.state.group(group.link.leader)
            if "slide" in fields:
                slide = fields["slide"]
                fields["target"] = self.state.place(group)
                if slide is not None and slide.free:
                    fields = {**fields, "target": self.mesh.V[group.vertices], "weight": inf}
            self._push(self.state.changed(group.number, **fields))
            self._jumped |= "slide" in fields

    def normal(self, number: int) -> np.ndarray:
        """Return the normal (3,) of a group; see :func:`sshade.edit.groups.normal`."""
        return normal(self.mesh, self.state.group(number))

    def frame(self, number: int) -> np.ndarray:
        """Return the local axes (3, 3) of a group; see :func:`sshade.edit.groups.frame`."""
        return frame(self.mesh, self.state.group(number))
