"""States of the editor, which undo returns to: selected vertices, handle groups, and the method."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, Literal, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.handle_checks import NO_HANDLES
from sshade.handles import Handles
from sshade.io.entries import REST
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.slides import Slide

Kind = Literal["static", "moving"]

#: Methods of the editor.
METHODS = ("fast", "fine", "paper")

#: Ways to change a selection. The first three take vertices.
WAYS = ("replace", "add", "remove", "all", "none", "invert", "grow", "shrink", "linked")
#: Number of kept states, and bytes of their shapes. Shapes of older states are computed again on demand.
STATES, BYTES = 1000, 500_000_000
#: Greatest ratio of the second extent of vertices to the first, at which they count as a line. Their targets
#: do not determine a rotation, which is therefore prescribed.
LINE = 1e-6
#: Greatest portion of a group whose mirror image may lie in the group itself.
OVERLAP = 0.25
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
    kind : {"static", "moving"}
    vertices : (k,) int64
    target : (k, 3) float64
        Targets of the vertices.
    weight : float
        Weight of a soft group, inf for a hard one; see :class:`sshade.Handles`.
    turn : (3, 3) float64, optional
        How far the group was turned.
    is_prescribed : bool
        Whether `turn` comes from a file, which prescribes the rotation of the surface at the vertices.
    slide : Slide, optional
        Set on which the vertices slide; None keeps them at their targets.

    Raises
    ------
    InputError
        On another kind, an empty or too long name, or a weight that is not above 0.
    """

    number: int
    name: str
    kind: Kind
    vertices: np.ndarray
    target: np.ndarray
    weight: float = inf
    turn: np.ndarray | None = None
    is_prescribed: bool = False
    slide: Slide | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("static", "moving"):
            raise InputError(f"a group is static or moving, not {self.kind!r}")
        if not 0 < len(self.name) <= LONGEST:
            raise InputError(f"a name has 1 to {LONGEST} characters")
        if not self.weight > 0:
            raise InputError("a weight is a number above 0; leave it empty for a hard group")
        if self.is_free and self.weight < inf:
            raise InputError("a group with a rotation only has no weight; leave it empty")

    @property
    def is_free(self) -> bool:
        """Whether the position is free. The targets are then at rest, as files say, and have no effect."""
        return self.slide is not None and self.slide.free

    @property
    def rotation(self) -> np.ndarray | None:
        """Prescribed rotation (3, 3) of the surface, unless the targets determine the rotation."""
        if self.turn is None and self.is_free:
            return np.eye(3)
        if self.turn is None or self.is_prescribed or self.slide is not None:
            return self.turn
        extents = np.linalg.svd(self.target - self.target.mean(axis=0), compute_uv=False)
        return self.turn if len(extents) < 2 or extents[1] <= LINE * extents[0] else None


class Settings(NamedTuple):
    """Method and constraints.

    Attributes
    ----------
    method : {"fast", "fine", "paper"}
    volume, area : bool
        Whether `fast` and `fine` constrain volume and area.
    """

    method: str = "fast"
    volume: bool = True
    area: bool = True

    @property
    def constraints(self) -> dict[str, float]:
        """Options of `fast` and `fine` that switch constraints off."""
        names = () if self.method == "paper" else ("volume", "area")
        return {name: 0.0 for name in names if not getattr(self, name)}


@dataclass(frozen=True, eq=False)
class State:
    """One step of the history.

    Parameters
    ----------
    selection : (k,) int64
        Selected vertices, ascending.
    groups : tuple of Group
        Disjoint groups.
    settings : Settings
    shape : (n, 3) float64, optional
        Converged positions of the mesh, once they are known.
    """

    selection: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    groups: tuple[Group, ...] = ()
    settings: Settings = Settings()
    shape: np.ndarray | None = None

    def same_shape(self, other: State) -> bool:
        """Whether both states have the same settings and groups, except for names of groups."""
        own, others = ([{**vars(group), "name": ""} for group in state.groups] for state in (self, other))
        same = all(a[name] is b[name] for a, b in zip(own, others, strict=False) for name in a)
        return same and len(own) == len(others) and self.settings == other.settings

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

    def place(self, group: Group) -> np.ndarray:
        """Return the positions (k, 3) from which a group moves.

        They are the targets, or where the vertices of a group slid to in the converged shape, if it is known.
        """
        if group.slide is None or self.shape is None:
            return group.target
        return group.slide.nearest(self.shape[group.vertices], group.target).position

    def changed(self, number: int, **fields: Any) -> State:
        """Return a state with changed fields of a group."""
        old = self.group(number)
        return replace(self, groups=tuple(replace(g, **fields) if g is old else g for g in self.groups))

    def moved(self, number: int, motion: Motion) -> State:
        """Return a state with a group moved from its current place.

        Raises
        ------
        InputError
            When the group is static.
        """
        group = self.group(number)
        if group.kind != "moving":
            raise InputError(f"{group.name} is static; make it moving to drag it")
        turn = group.turn
        if turn is not None or not np.array_equal(motion.R, np.eye(3)):
            turn = motion.R if turn is None else motion.R @ turn
        target = group.target if group.is_free else motion(self.place(group))
        return self.changed(number, target=target, turn=turn)

    def marked(self, new: Group) -> State:
        """Return a state with another group, whose vertices leave the selection and all other groups."""
        groups = []
        for group in self.groups:
            keep = ~np.isin(group.vertices, new.vertices, assume_unique=True)
            if keep.all():
                groups.append(group)
            elif keep.any():
                groups.append(replace(group, vertices=group.vertices[keep], target=group.target[keep]))
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
        # Static handles of a file stay at rest. A static group elsewhere is therefore written as dynamic.
        at_rest = [
            group.kind == "static" and np.array_equal(group.target, mesh.V[group.vertices])
            for group in self.groups
        ]
        target, rotation = self.aims()
        slides = np.array([group.slide for group in self.groups], dtype=object)
        slide = np.repeat(slides, count) if any(slides) else None
        return Handles(
            np.concatenate([group.vertices for group in self.groups]),
            target,
            dynamic=~np.repeat(at_rest, count),
            group=np.repeat(np.arange(len(count)), count),
            weight=np.repeat([group.weight for group in self.groups], count),
            rotation=rotation,
            slide=slide,
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


def groups_of(handles: Handles, names: dict[int, str], *, first: int) -> tuple[Group, ...]:
    """Convert handles of a file to groups.

    Parameters
    ----------
    handles : Handles
    names : mapping
        Names of groups of `handles`. Other groups are named by their number.
    first : int
        Number of the first group.
    """
    groups = []
    for number, group in enumerate(np.unique(handles.group), start=first):
        members = np.flatnonzero(handles.group == group)
        name = names.get(int(group), "")[:LONGEST] or f"group {number}"
        kind: Kind = "moving" if handles.dynamic[members].any() else "static"
        vertices, target = handles.index[members], handles.target[members]
        one = Group(number, name, kind, vertices, target, float(handles.weight[members[0]]))
        if handles.rotation is not None and handles.has_rotation[members[0]]:
            one = replace(one, turn=handles.rotation[members[0]], is_prescribed=True)
        if handles.slide is not None:
            one = replace(one, slide=handles.slide[members[0]])
        groups.append(one)
    return tuple(groups)


class History:
    """A list of states and a current state.

    Parameters
    ----------
    first : State
    """

    def __init__(self, first: State) -> None:
        self._states, self._at = [first], 0

    @property
    def state(self) -> State:
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

    def push(self, state: State) -> None:
        """Append a state and make it the current one; states that were undone are dropped."""
        self._states = [*self._states[: self._at + 1], state][-STATES:]
        self._at = len(self._states) - 1

    def go(self, steps: int) -> None:
        """Go forth, or back if `steps` is negative, as far as there are states."""
        self._at = min(max(self._at + steps, 0), len(self._states) - 1)

    def store_shape(self, state: State, shape: np.ndarray) -> None:
        """Store the converged shape of a state, also for states that differ in the selection only."""
        for i, other in enumerate(self._states):
            if other.same_shape(state):
                self._states[i] = replace(other, shape=shape)
        self._drop_shapes()

    def _drop_shapes(self) -> None:
        """Drop the oldest shapes until all shapes fit in :data:`BYTES`."""
        kept = {id(self.state.shape): 0 if self.state.shape is None else self.state.shape.nbytes}
        for i in range(len(self._states) - 1, -1, -1):
            shape = self._states[i].shape
            if shape is None or id(shape) in kept:
                continue
            if sum(kept.values()) + shape.nbytes > BYTES:
                self._states[i] = replace(self._states[i], shape=None)
            else:
                kept[id(shape)] = shape.nbytes


def selected(mesh: Mesh, before: np.ndarray, vertices: np.ndarray, how: str) -> np.ndarray:
    """Change a selection.

    Parameters
    ----------
    mesh : Mesh
    before : (j,) int64
        Selected vertices.
    vertices : (k,) int
        Vertices for "replace", "add" and "remove".
    how : str
        A word of :data:`WAYS`. "grow" adds the neighbours of selected vertices; "shrink" removes selected
        vertices with a neighbour that is not selected; "linked" adds all vertices of their components.

    Returns
    -------
    (j',) int64
        Selected vertices, ascending.

    Raises
    ------
    InputError
        When `how` is another word, or a vertex is out of range.
    """
    if how not in WAYS:
        raise InputError(f"{how!r} is no way to pick vertices; use {', '.join(WAYS)}")
    if vertices.ndim != 1 or (len(vertices) and (vertices.min() < 0 or vertices.max() >= mesh.n)):
        raise InputError(f"vertices to pick are numbers from 0 to {mesh.n - 1}")
    chosen = np.zeros(mesh.n, dtype=bool)
    chosen[before] = how not in ("replace", "none")
    if how in ("replace", "add", "remove"):
        chosen[vertices] = how != "remove"
    elif how == "all":
        chosen[:] = True
    elif how == "invert":
        chosen = ~chosen
    elif how in ("grow", "shrink"):
        ends = chosen[mesh.edges]
        chosen[mesh.edges[ends[:, 0] != ends[:, 1]]] = how == "grow"
    elif how == "linked":
        chosen = np.isin(mesh.component, mesh.component[before])
    return np.flatnonzero(chosen)


def near(mesh: Mesh, vertices: np.ndarray, distance: float) -> np.ndarray:
    """Find the vertices within a distance of other vertices, measured along the edges of the rest shape.

    Parameters
    ----------
    mesh : Mesh
    vertices : (k,) int64
    distance : float
        In the unit of the mesh.

    Returns
    -------
    (n,) bool

    Raises
    ------
    InputError
        When there are no vertices, or the distance is not above 0.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    if len(vertices) == 0:
        raise InputError("no vertex is picked from which a distance could be measured")
    if not distance > 0:
        raise InputError(f"a distance is a number above 0, not {distance:g}")
    found, (i, j) = np.zeros(mesh.n, dtype=bool), mesh.edges.T
    found[vertices] = True
    border = np.unique(mesh.edges[found[i] != found[j]])  # paths from the vertices begin there
    border = border[found[border]]
    if len(border) == 0:
        return found
    length = np.linalg.norm(mesh.V[i] - mesh.V[j], axis=1)
    graph = coo_array((length, (i, j)), shape=(mesh.n, mesh.n)).tocsr()
    return found | np.isfinite(dijkstra(graph, directed=False, indices=border, min_only=True, limit=distance))


def mirrored(mesh: Mesh, group: Group, axis: int, *, number: int) -> Group:
    """Mirror a group in the middle plane of the rest shape.

    Parameters
    ----------
    mesh : Mesh
    group : Group
    axis : int
        Coordinate whose sign changes: 0, 1 or 2.
    number : int
        Number of the new group.

    Returns
    -------
    Group
        The vertices nearest to the mirrored vertices, without those of `group`, moved by the mirrored motion.

    Raises
    ------
    InputError
        When the group lies on both sides, the other side has no vertices within the mean length of an edge,
        or the group slides on a surface from a file.
    """
    from scipy.spatial import cKDTree

    middle = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))
    S = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
    rest, slide = mesh.V[group.vertices], group.slide
    distance, found = cKDTree(mesh.V, balanced_tree=False).query((rest - middle) @ S + middle)
    if np.isin(found, group.vertices).mean() > OVERLAP:
        raise InputError(f"{group.name} lies on both sides of the middle; mirror a group of one side")
    vertices = np.setdiff1d(found[distance <= mesh.mean_edge], group.vertices)
    if len(vertices) == 0:
        raise InputError(f"the mesh has no vertices on the other side of {group.name}")
    if slide is not None and "slide" in slide.record:
        ((kind, value),) = slide.record["slide"].items()
        if kind == "surface" and value != REST:
            raise InputError(f"{group.name} slides on a surface, which has no mirrored surface")
        if kind in ("plane", "line"):
            slide = (Slide.plane if kind == "plane" else Slide.line)(S @ value)
    R, t = rigid_motion(rest, group.target)
    R, t = S @ R @ S, S @ (R @ middle + t - middle) + middle - S @ R @ S @ middle
    still = np.array_equal(group.target, rest)
    return replace(
        group,
        number=number,
        name=f"{group.name[: LONGEST - 9]} mirrored",
        vertices=vertices,
        target=mesh.V[vertices] if still else mesh.V[vertices] @ R.T + t,
        turn=None if group.turn is None else S @ group.turn @ S,
        slide=slide,
    )
