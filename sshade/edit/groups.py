"""Groups of the editor: vertices that are fixed or moved, and rigid motions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Literal, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.problem.handles import Handles

GroupKind = Literal["fixed", "moved"]

#: Greatest ratio of the second extent of vertices to the first, at which they count as a line. Their targets
#: do not determine a rotation, which is therefore prescribed.
LINE = 1e-6
#: Greatest length of a group's name.
LONGEST = 80


class Motion(NamedTuple):
    """A rigid motion: x moves to R x + t.

    Attributes
    ----------
    R : (3, 3) float64
    t : (3,) float64
    """

    R: np.ndarray
    t: np.ndarray

    @classmethod
    def about(cls, pivot: np.ndarray, quaternion: np.ndarray, move: np.ndarray) -> Motion:
        """Return a rotation about the point `pivot`, followed by the translation `move`.

        Parameters
        ----------
        pivot, move : (3,) float64
        quaternion : (4,) float64
            Rotation x, y, z, w, of any length but zero.
        """
        from scipy.spatial.transform import Rotation

        # A translation must not leave rounding in R: :attr:`Group.rotation` would take it for a rotation.
        R = Rotation.from_quat(quaternion).as_matrix() if np.any(quaternion[:3]) else np.eye(3)
        return cls(R, pivot - R @ pivot + move)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Move points (k, 3)."""
        if np.array_equal(self.R, np.eye(3)) and not self.t.any():
            return points
        return points @ self.R.T + self.t


@dataclass(frozen=True, eq=False)
class Group:
    """Vertices that are fixed, or moved rigidly.

    Parameters
    ----------
    number : int
        Unique among all groups of a session.
    name : str
    kind : {"fixed", "moved"}
    vertices : (k,) int64
    target : (k, 3) float64
        Targets of the vertices.
    weight : float
        Weight of a soft group, inf for a hard one; see :class:`sshade.Handles`.
    turn : (3, 3) float64, optional
        How far the group was turned.
    is_prescribed : bool
        Whether `turn` comes from a file, which prescribes the rotation of the surface at the vertices.

    Raises
    ------
    InputError
        On an empty or too long name, or a weight that is not above 0.
    """

    number: int
    name: str
    kind: GroupKind
    vertices: np.ndarray
    target: np.ndarray
    weight: float = inf
    turn: np.ndarray | None = None
    is_prescribed: bool = False

    def __post_init__(self) -> None:
        if not 0 < len(self.name) <= LONGEST:
            raise InputError(f"a name has 1 to {LONGEST} characters")
        if not self.weight > 0:
            raise InputError("a weight is a number above 0; leave it empty for a hard group")

    def kept(self, keep: np.ndarray) -> Group:
        """Return the group with some of its vertices, keep (k,) bool."""
        return replace(self, vertices=self.vertices[keep], target=self.target[keep])

    @property
    def rotation(self) -> np.ndarray | None:
        """Prescribed rotation (3, 3) of the surface, unless the targets determine the rotation."""
        if self.turn is None or self.is_prescribed:
            return self.turn
        extents = np.linalg.svd(self.target - self.target.mean(axis=0), compute_uv=False)
        return self.turn if len(extents) < 2 or extents[1] <= LINE * extents[0] else None


def groups_of(handles: Handles, names: dict[int, str]) -> tuple[Group, ...]:
    """Convert handles of a file to groups, numbered from 1.

    Parameters
    ----------
    handles : Handles
    names : mapping
        Names of groups of `handles`. Other groups are named by their number.
    """
    groups = []
    for number, group in enumerate(np.unique(handles.group), start=1):
        members = np.flatnonzero(handles.group == group)
        name = names.get(int(group), "")[:LONGEST] or f"group {number}"
        kind: GroupKind = "moved" if handles.dynamic[members].any() else "fixed"
        vertices, target = handles.index[members], handles.target[members]
        one = Group(number, name, kind, vertices, target, float(handles.weight[members[0]]))
        if handles.rotation is not None and handles.has_rotation[members[0]]:
            one = replace(one, turn=handles.rotation[members[0]], is_prescribed=True)
        groups.append(one)
    return tuple(groups)
