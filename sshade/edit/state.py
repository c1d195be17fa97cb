"""What an editor holds at one time: the vertices picked, the handle groups and where they are, the method."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, Literal, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.handles import NO_HANDLES, Handles
from sshade.mesh.mesh import Mesh

Kind = Literal["static", "moving"]
MethodName = Literal["sshade_fast", "sshade_fine", "sshade"]

#: Second extent of vertices over their first one, up to which they lie on a line: no rotation moves
#: a vertex then, or only some of them, and the surface is told how it turns.
LINE = 1e-6
#: Characters of a group's name.
LONGEST = 80


class Motion(NamedTuple):
    """x goes to R x + t.

    Attributes
    ----------
    R : (3, 3) float64
    t : (3,) float64
    """

    R: np.ndarray
    t: np.ndarray

    @classmethod
    def none(cls) -> Motion:
        """All stays."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def about(cls, pivot: np.ndarray, quaternion: np.ndarray, move: np.ndarray) -> Motion:
        """A turn about a point, then a move.

        Parameters
        ----------
        pivot, move : (3,) float64
        quaternion : (4,) float64
            x, y, z, w, of any length but zero.
        """
        from scipy.spatial.transform import Rotation

        # A move alone leaves no rounding in R, which would be a rotation to :attr:`Group.rotation`.
        R = Rotation.from_quat(quaternion).as_matrix() if np.any(quaternion[:3]) else np.eye(3)
        return cls(R, pivot - R @ pivot + move)

    def after(self, first: Motion) -> Motion:
        """The motion `first`, then this one."""
        return Motion(self.R @ first.R, self.R @ first.t + self.t)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(k, 3) points where they go."""
        if np.array_equal(self.R, np.eye(3)) and not self.t.any():
            return points
        return points @ self.R.T + self.t


@dataclass(frozen=True, eq=False)
class Group:
    """Vertices that are held, or moved as one.

    Parameters
    ----------
    number : int
        Its own for as long as it exists.
    name : str
    kind : {"static", "moving"}
    vertices : (k,) int64
    start : (k, 3) float64
        Where they were when they were marked, or where a file wants them.
    motion : Motion
        From there.
    weight : float
        Of a soft group, see :class:`sshade.Handles`.
    turn : (3, 3) float64, optional
        Rotation of the surface around them that a file prescribes.

    Raises
    ------
    InputError
        On another kind, a name that is empty or long, a weight that is not above 0.
    """

    number: int
    name: str
    kind: Kind
    vertices: np.ndarray
    start: np.ndarray
    motion: Motion = field(default_factory=Motion.none)
    weight: float = inf
    turn: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("static", "moving"):
            raise InputError(f"a group is static or moving, not {self.kind!r}")
        if not 0 < len(self.name) <= LONGEST:
            raise InputError(f"a name has 1 to {LONGEST} characters")
        if not self.weight > 0:
            raise InputError("a weight is a number above 0; without one the group is held")

    @property
    def target(self) -> np.ndarray:
        """(k, 3) where the vertices are to go."""
        return self.motion(self.start)

    @property
    def rotation(self) -> np.ndarray | None:
        """(3, 3) how the surface is to turn around the vertices, where their targets do not say it."""
        if self.turn is not None:
            return self.motion.R @ self.turn
        if np.array_equal(self.motion.R, np.eye(3)):
            return None
        extents = np.linalg.svd(self.start - self.start.mean(axis=0), compute_uv=False)
        return self.motion.R if len(extents) < 2 or extents[1] <= LINE * extents[0] else None


class Settings(NamedTuple):
    """How the mesh follows.

    Attributes
    ----------
    method : {"sshade_fast", "sshade_fine", "sshade"}
    volume, area : bool
        Whether the constraints of the first two methods are as usual, or free.
    """

    method: MethodName = "sshade_fast"
    volume: bool = True
    area: bool = True

    @property
    def constraints(self) -> dict[str, float]:
        """Options of a method that is not the paper's, which are 0 where something is free."""
        return {name: 0.0 for name in ("volume", "area") if not getattr(self, name)}


@dataclass(frozen=True, eq=False)
class State:
    """One step of the history.

    Parameters
    ----------
    selection : (k,) int64
        Vertices picked, ascending.
    groups : tuple of Group
        No vertex is in two.
    settings : Settings
    shape : (n, 3) float64, optional
        The mesh with these groups by this method, once it is known.
    """

    selection: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    groups: tuple[Group, ...] = ()
    settings: Settings = Settings()
    shape: np.ndarray | None = None

    def same_shape(self, other: State) -> bool:
        """Whether both have the same groups and method."""
        return self.groups is other.groups and self.settings == other.settings

    def group(self, number: int) -> Group:
        """One of the groups.

        Raises
        ------
        InputError
            When there is none of that number.
        """
        for group in self.groups:
            if group.number == number:
                return group
        raise InputError(f"there is no group {number}")

    def changed(self, number: int, **fields: Any) -> State:
        """With some fields of a group changed."""
        own = self.group(number)
        return replace(self, groups=tuple(replace(g, **fields) if g is own else g for g in self.groups))

    def moved(self, number: int, motion: Motion) -> State:
        """With a group moved from where it is.

        Raises
        ------
        InputError
            When it is static.
        """
        group = self.group(number)
        if group.kind != "moving":
            raise InputError(f"{group.name} is static; make it moving to drag it")
        return self.changed(number, motion=motion.after(group.motion))

    def marked(self, new: Group) -> State:
        """With a group more, of the vertices that were picked; other groups lose them."""
        groups = []
        for group in self.groups:
            keep = ~np.isin(group.vertices, new.vertices, assume_unique=True)
            if keep.all():
                groups.append(group)
            elif keep.any():
                groups.append(replace(group, vertices=group.vertices[keep], start=group.start[keep]))
        return replace(self, selection=new.vertices[:0], groups=(*groups, new))

    def handles(self, mesh: Mesh) -> Handles:
        """The groups as handles, numbered from 0 in their order.

        Raises
        ------
        InputError
            When there are none.
        """
        if not self.groups:
            raise InputError(NO_HANDLES)
        count = [len(group.vertices) for group in self.groups]
        # What is static in a file stays at rest: a group that was fixed in another place is no such one.
        still = [
            group.kind == "static" and np.array_equal(group.target, mesh.V[group.vertices])
            for group in self.groups
        ]
        target, rotation = self.aims()
        return Handles(
            np.concatenate([group.vertices for group in self.groups]),
            target,
            dynamic=~np.repeat(still, count),
            group=np.repeat(np.arange(len(count)), count),
            weight=np.repeat([group.weight for group in self.groups], count),
            rotation=rotation,
        )

    def aims(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Targets (k, 3) of all groups' vertices, and rotations (k, 3, 3), NaN where open, if one has any."""
        target = np.concatenate([group.target for group in self.groups])
        turns = [group.rotation for group in self.groups]
        if all(turn is None for turn in turns):
            return target, None
        given = [np.full((3, 3), np.nan) if turn is None else turn for turn in turns]
        return target, np.repeat(given, [len(group.vertices) for group in self.groups], axis=0)

    def displaced(self, mesh: Mesh) -> bool:
        """Whether a group is to be elsewhere than at rest."""
        return any(
            group.rotation is not None or not np.array_equal(group.target, mesh.V[group.vertices])
            for group in self.groups
        )


def groups_of(handles: Handles, names: dict[int, str], *, first: int) -> tuple[Group, ...]:
    """Handles of a file as groups.

    Parameters
    ----------
    handles : Handles
    names : mapping
        Of their groups, where those have names.
    first : int
        Number of the first group.
    """
    groups = []
    for number, own in enumerate(np.unique(handles.group)):
        members = np.flatnonzero(handles.group == own)
        some: dict[str, Any] = {"weight": float(handles.weight[members[0]])}
        if handles.rotation is not None and np.isfinite(handles.rotation[members[0]]).all():
            some["turn"] = handles.rotation[members[0]]
        kind: Kind = "moving" if handles.dynamic[members].any() else "static"
        name = names.get(int(own), "")[:LONGEST] or f"group {first + number}"
        given = handles.index[members], handles.target[members]
        groups.append(Group(first + number, name, kind, *given, **some))
    return tuple(groups)
