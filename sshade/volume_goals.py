"""Goals for the volume of a mesh or of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sshade.errors import InputError

#: Largest goal. Beyond, products of coordinates overflow.
LARGEST = 1e100


@dataclass(frozen=True, eq=False)
class VolumeGoal:
    """The volume that a part of a mesh is to have.

    The volume of a part is the volume inside its faces and its caps. A cap closes each boundary loop of the
    part by a fan of triangles around the centroid of the loop. The holes of an open mesh are closed alike.

    Parameters
    ----------
    ratio : float, optional
        Goal as a multiple of the volume at rest.
    volume : float, optional
        Goal in the unit of length, cubed. Either `ratio` or `volume` is given.
    faces : (k,) int or (m,) bool, optional
        Faces of the part; by default the whole mesh. A part that lies in several components is one goal for
        each component: all have the same ratio.
    name : str
        Name for messages.

    Raises
    ------
    InputError
        Unless one goal is given, positive and finite, and the part has faces.

    Examples
    --------
    >>> VolumeGoal(ratio=1.2, faces=[4, 5, 7], name="belly").faces
    array([4, 5, 7])
    >>> VolumeGoal(ratio=-1.0)
    Traceback (most recent call last):
    ...
    sshade.errors.InputError: the volume goal of the mesh must be a finite number above 0, not -1
    """

    ratio: float | None = None
    volume: float | None = None
    faces: np.ndarray | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if (self.ratio is None) == (self.volume is None):
            raise InputError(
                f'the volume goal of {self.title} needs either a ratio (in a file, "goal") or a volume'
            )
        goal = self.volume if self.ratio is None else self.ratio
        number = isinstance(goal, int | float | np.number) and not isinstance(goal, bool)
        if not number or not 0 < goal < LARGEST:  # type: ignore[operator]
            shown = f"{goal:g}" if isinstance(goal, float) else repr(goal)[:40]
            raise InputError(f"the volume goal of {self.title} must be a finite number above 0, not {shown}")
        if self.faces is None:
            return
        faces = np.asarray(self.faces)
        if faces.dtype == bool:
            object.__setattr__(self, "_masked", faces.size)  # no field: goals of other meshes have ids
            faces = np.flatnonzero(faces)
        if faces.size == 0:
            raise InputError(f"the volume goal of {self.title} has no faces")
        if faces.ndim != 1 or not np.issubdtype(faces.dtype, np.integer):
            raise InputError(f"the faces of {self.title} must be a list of face ids")
        object.__setattr__(self, "faces", np.unique(faces).astype(np.int64))

    @property
    def title(self) -> str:
        """The part in words, for messages."""
        return f"the part {self.name!r}" if self.name else "a part" if self.faces is not None else "the mesh"


def check_goals(goals: Sequence[VolumeGoal], m: int) -> tuple[VolumeGoal, ...]:
    """Return the goals of a mesh of m faces, and raise InputError on faces out of range or in two parts."""
    if isinstance(goals, VolumeGoal):
        raise InputError("volumes is a list of VolumeGoal; put the goal into brackets")
    for goal in goals:
        if not isinstance(goal, VolumeGoal):
            raise InputError(f"volumes is a list of VolumeGoal, not of {type(goal).__name__}")
        if (masked := getattr(goal, "_masked", m)) != m:
            raise InputError(f"{goal.title} has a mask of {masked} faces, but the mesh has {m}")
        ids = np.empty(0, dtype=np.int64) if goal.faces is None else goal.faces
        if len(outside := ids[(ids < 0) | (ids >= m)]):
            raise InputError(f"{goal.title} has face {outside[0]}, but the mesh has faces 0 to {m - 1}")
    if sum(goal.faces is None for goal in goals) > 1:
        raise InputError("the whole mesh has two volume goals; give one")
    parts = [goal for goal in goals if goal.faces is not None and len(goal.faces) < m]
    for one, other in combinations(parts, 2):
        assert one.faces is not None and other.faces is not None
        if common := len(np.intersect1d(one.faces, other.faces, assume_unique=True)):
            raise InputError(
                f"{one.title} and {other.title} have {common} faces in common; parts must not overlap"
            )
    return tuple(goals)


def restricted(
    goals: Sequence[VolumeGoal], F: np.ndarray, of: np.ndarray, *, strict: bool = False
) -> tuple[VolumeGoal, ...]:
    """Return goals for other faces: goals without any of the faces are left out.

    Parameters
    ----------
    goals : sequence of VolumeGoal
    F : (m, 3) int
        Faces that the goals name.
    of : (l, 3) int
        Faces of another mesh, with the same vertex ids as `F`. A face is the same with its corners in
        another order.
    strict : bool
        Raise InputError on goals that are left out.
    """
    found = []
    for goal in goals:
        if goal.faces is None:
            found.append(goal)
            continue
        rows = np.sort(np.concatenate([of, F[goal.faces]]), axis=1)
        _, key = np.unique(rows, axis=0, return_inverse=True)
        faces = np.flatnonzero(np.isin(key[: len(of)], key[len(of) :]))
        if len(faces):
            found.append(VolumeGoal(goal.ratio, goal.volume, faces, goal.name))
        elif strict:
            raise InputError(f"{goal.title} has no face that can be deformed")
    return tuple(found)
