"""States of the editor, which undo returns to: selected vertices, handle groups, and the method's options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.edit.groups import Group, Motion
from sshade.mesh.mesh import Mesh
from sshade.problem.handle_checks import NO_HANDLES
from sshade.problem.handles import Handles
from sshade.problem.options import Options, accepted, resolve

#: Number of kept states, and bytes of their shapes. Shapes of older states are computed again on demand.
STATES, BYTES = 1000, 500_000_000


@dataclass(frozen=True, eq=False)
class EditState:
    """One step of the history.

    Parameters
    ----------
    selection : (k,) int64
        Selected vertices, ascending.
    groups : tuple of Group
        Disjoint groups.
    method : {"fast", "fine", "paper"}
    options : mapping
        Options that differ from the defaults; the method does not use the options of other methods.
    shape : (n, 3) float64, optional
        Converged positions of the mesh, once they are known.
    quality : str
        How far the shape is distorted, in words.
    """

    selection: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    groups: tuple[Group, ...] = ()
    method: str = "fast"
    options: Mapping[str, Any] = field(default_factory=dict)
    shape: np.ndarray | None = None
    quality: str = ""

    @property
    def made(self) -> dict[str, Any]:
        """The method and its options, for handle files."""
        own = accepted(self.method)
        return {"method": self.method, **{name: x for name, x in self.options.items() if name in own}}

    @property
    def resolved(self) -> Options:
        """The options of the method."""
        values = self.made
        return resolve(values.pop("method"), values)

    def same_shape(self, other: EditState) -> bool:
        """Whether both states have the same options and groups, except for names of groups."""
        own, others = ([{**vars(group), "name": ""} for group in state.groups] for state in (self, other))
        same = all(a[name] is b[name] for a, b in zip(own, others, strict=False) for name in a)
        return same and len(own) == len(others) and self.made == other.made

    def group(self, number: int) -> Group:
        """Return the group with a number.

        Raises
        ------
        InputError
            When there is no such group.
        """
        for group in self.groups:
            if group.number == number:
                return group
        raise InputError(f"there is no group {number}")

    def changed(self, number: int, **fields: Any) -> EditState:
        """Return a state with changed fields of a group."""
        old = self.group(number)
        return replace(self, groups=tuple(replace(g, **fields) if g is old else g for g in self.groups))

    def moved(self, number: int, motion: Motion) -> EditState:
        """Return a state with a group moved from its targets.

        Raises
        ------
        InputError
            When the group is fixed.
        """
        group = self.group(number)
        if group.kind != "moved":
            raise InputError(f"{group.name} is fixed; set it to moved to drag it")
        turn = group.turn
        if turn is not None or not np.array_equal(motion.R, np.eye(3)):
            turn = motion.R if turn is None else motion.R @ turn
        return self.changed(number, target=motion(group.target), turn=turn)

    def marked(self, new: Group) -> EditState:
        """Return a state with another group, whose vertices leave the selection and all other groups."""
        groups = []
        for group in self.groups:
            keep = ~np.isin(group.vertices, new.vertices, assume_unique=True)
            if keep.all():
                groups.append(group)
            elif keep.any():
                groups.append(group.kept(keep))
        return replace(self, selection=new.vertices[:0], groups=(*groups, new))

    def handles(self, mesh: Mesh) -> Handles:
        """Return the groups as handles, numbered from 0.

        Raises
        ------
        InputError
            When there are no groups.
        """
        if not self.groups:
            raise InputError(NO_HANDLES)
        count = [len(group.vertices) for group in self.groups]
        # Static handles of a file stay at rest. A fixed group elsewhere is therefore written as dynamic.
        at_rest = [
            group.kind == "fixed" and np.array_equal(group.target, mesh.V[group.vertices])
            for group in self.groups
        ]
        target, rotation = self.aims()
        return Handles(
            np.concatenate([group.vertices for group in self.groups]),
            target,
            dynamic=~np.repeat(at_rest, count),
            group=np.repeat(np.arange(len(count)), count),
            weight=np.repeat([group.weight for group in self.groups], count),
            rotation=rotation,
        )

    def aims(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the targets (k, 3) of all groups and their prescribed rotations (k, 3, 3).

        Rotations are NaN where none is prescribed, and None if no group has one.
        """
        target = np.concatenate([group.target for group in self.groups])
        rotations = [group.rotation for group in self.groups]
        if all(rotation is None for rotation in rotations):
            return target, None
        filled = [np.full((3, 3), np.nan) if rotation is None else rotation for rotation in rotations]
        return target, np.repeat(filled, [len(group.vertices) for group in self.groups], axis=0)

    def displaced(self, mesh: Mesh) -> bool:
        """Whether a group has targets away from rest, or a prescribed rotation."""
        return any(
            group.rotation is not None or not np.array_equal(group.target, mesh.V[group.vertices])
            for group in self.groups
        )


class History:
    """A list of states and a current state.

    Parameters
    ----------
    first : EditState
    """

    def __init__(self, first: EditState) -> None:
        self._states, self._at = [first], 0

    @property
    def state(self) -> EditState:
        """Current state."""
        return self._states[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier state."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a later state."""
        return self._at < len(self._states) - 1

    def push(self, state: EditState) -> None:
        """Append a state and make it the current one; states that were undone are dropped."""
        self._states = [*self._states[: self._at + 1], state][-STATES:]
        self._at = len(self._states) - 1

    def go(self, steps: int) -> None:
        """Go forth, or back if `steps` is negative, as far as there are states."""
        self._at = min(max(self._at + steps, 0), len(self._states) - 1)

    def store_shape(self, state: EditState, shape: np.ndarray, quality: str) -> None:
        """Store the converged shape of a state, also for states that differ in the selection only.

        The oldest shapes are dropped until all fit in :data:`BYTES`.
        """
        for i, other in enumerate(self._states):
            if other.same_shape(state):
                self._states[i] = replace(other, shape=shape, quality=quality)
        room, kept = BYTES // shape.nbytes, {id(self.state.shape)}
        for i in range(len(self._states) - 1, -1, -1):
            one = self._states[i].shape
            if one is None:
                continue
            if id(one) in kept or len(kept) < room:
                kept.add(id(one))
            else:
                self._states[i] = replace(self._states[i], shape=None)
