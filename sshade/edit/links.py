"""Groups that follow other groups: mirror images, and surroundings that follow less with the distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.edit.selection import distances
from sshade.errors import InputError
from sshade.io.entries import REST
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.slides import Slide

if TYPE_CHECKING:
    from sshade.edit.groups import Group

#: Greatest portion of a group whose mirror image may lie in the group itself.
OVERLAP = 0.25
#: Weight of surroundings. Smaller weights smooth the edges of a falloff more, and let everything beyond move.
SOFT = 1000.0
#: Largest difference of equal positions, as a fraction of the diagonal, and of equal rotations.
SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Link:
    """How a group follows another group, its leader.

    Parameters
    ----------
    leader : int
        Number of the leader.
    axis : int, optional
        The group makes the motion of the leader, mirrored across this coordinate in the middle of the mesh.
    distance : float
        The group makes a part of the motion of the leader, which falls to 0 within this distance.
    influence : (k,) float64, optional
        The part that each vertex makes, from 0 to 1.
    slide : Slide, optional
        The slide of the leader whose mirror image the group has.
    """

    leader: int
    axis: int | None = None
    distance: float = 0.0
    influence: np.ndarray | None = None
    slide: Slide | None = None

    def kept(self, keep: np.ndarray) -> Link:
        """Return the link of some vertices of the group, keep (k,) bool."""
        return self if self.influence is None else replace(self, influence=self.influence[keep])


def reflection(axis: int) -> np.ndarray:
    """Return the matrix (3, 3) that changes the sign of a coordinate."""
    return np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))


def middle(mesh: Mesh) -> np.ndarray:
    """Return the centre (3,) of the bounding box, through which mirrors go."""
    return 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))


def mirrored_vertices(mesh: Mesh, vertices: np.ndarray, axis: int) -> np.ndarray:
    """Return the vertices (j,) nearest to mirror images, at most the mean length of an edge away."""
    from scipy.spatial import cKDTree

    centre = middle(mesh)
    image = (mesh.V[vertices] - centre) @ reflection(axis) + centre
    distance, found = cKDTree(mesh.V, balanced_tree=False).query(image)
    return found[distance <= mesh.mean_edge]


def mirrored_slide(slide: Slide | None, axis: int, name: str) -> Slide | None:
    """Return the mirror image of a slide; raise InputError, which begins with `name`, if it has none."""
    if slide is None or "slide" not in slide.record:
        return slide
    ((kind, value),) = slide.record["slide"].items()
    if kind == "surface" and value != REST:
        raise InputError(f"{name} slides on a surface, which has no mirrored surface")
    if kind in ("plane", "line"):
        return (Slide.plane if kind == "plane" else Slide.line)(reflection(axis) @ value)
    return slide


def sides(mesh: Mesh, vertices: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide vertices (k,) into connected pieces above, below and across the middle of the mesh."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    place = np.full(mesh.n, -1)
    place[vertices] = np.arange(len(vertices))
    i, j = place[mesh.edges].T
    inside = (i >= 0) & (j >= 0)
    graph = coo_array((np.ones(inside.sum()), (i[inside], j[inside])), shape=(len(vertices),) * 2)
    _, piece = connected_components(graph, directed=False)
    above = mesh.V[vertices, axis] > middle(mesh)[axis]
    portion = np.bincount(piece, above) / np.bincount(piece)
    return vertices[portion[piece] == 1], vertices[portion[piece] == 0], vertices[portion[piece] % 1 > 0]


def recorded(groups: Sequence[Group]) -> list[Any]:
    """Return the links of groups for a file: null, or the place of the leader, the axis and the distance."""
    place = {group.number: i for i, group in enumerate(groups)}
    return [one.link and [place[one.link.leader], one.link.axis, one.link.distance] for one in groups]


def linked(mesh: Mesh, groups: tuple[Group, ...], record: Any) -> tuple[Group, ...]:
    """Return groups with the links of :func:`recorded`, or without links if another program changed the file.

    Parameters
    ----------
    mesh : Mesh
    groups : tuple of Group
    record
        Anything that a file holds.
    """
    if not isinstance(record, list) or len(record) != len(groups):
        return groups
    made: list[Group] = []
    for group, entry in zip(groups, record, strict=True):
        link = None
        match entry:
            case [int(place), 0 | 1 | 2 as axis, _] if 0 <= place < len(made):
                link = Link(made[place].number, axis, slide=made[place].slide)
            case [int(place), None, int() | float() as distance] if 0 <= place < len(made) and distance > 0:
                away = distances(mesh, made[place].vertices, distance)[group.vertices]
                link = Link(made[place].number, None, distance, falloff(away, distance))
        made.append(replace(group, link=link))
    return tuple(made)


def falloff(distance: np.ndarray, reach: float) -> np.ndarray:
    """Return a smooth step from 1 at distance 0 to 0 at `reach`."""
    t = np.clip(1 - distance / reach, 0, 1)
    return t * t * (3 - 2 * t)


def followed(mesh: Mesh, groups: tuple[Group, ...]) -> tuple[Group, ...]:
    """Return the groups with all followers where their leaders, which come before them, take them.

    A group whose leader is gone follows nothing. Groups that stay are the same objects.
    """
    found: dict[int, Group] = {}
    for group in groups:
        if group.link is not None:
            leader = found.get(group.link.leader)
            group = replace(group, link=None) if leader is None else _follow(mesh, group, group.link, leader)
        found[group.number] = group
    same = all(new is old for new, old in zip(found.values(), groups, strict=True))
    return groups if same else tuple(found.values())


def _follow(mesh: Mesh, group: Group, link: Link, leader: Group) -> Group:
    """Move a group as its leader moved."""
    rest, centre = mesh.V[group.vertices], mesh.V[leader.vertices].mean(axis=0)
    still = np.array_equal(leader.target, mesh.V[leader.vertices])
    R = None if leader.is_prescribed else leader.rotation
    if R is None:
        R = np.eye(3) if still else rigid_motion(mesh.V[leader.vertices], leader.target)[0]
    move = leader.target.mean(axis=0) - centre
    if link.axis is None:
        target = rest if still else _partly(rest, link.influence, R, centre, move)
        return group if _same(target, group.target, mesh.diagonal) else replace(group, target=target)
    S = reflection(link.axis)
    if leader.slide is not link.slide:
        slide = mirrored_slide(leader.slide, link.axis, leader.name)
        group = replace(group, slide=slide, link=replace(link, slide=leader.slide))
    own = (centre - middle(mesh)) @ S + middle(mesh)
    target = rest if still else (rest - own) @ (S @ R @ S).T + own + S @ move
    turn = None if leader.turn is None else S @ leader.turn @ S
    if _same(target, group.target, mesh.diagonal):  # the same arrays tell that the shape stays
        target = group.target
    if turn is not None and group.turn is not None and _same(turn, group.turn, 1.0):
        turn = group.turn
    fields: dict[str, Any] = {name: getattr(leader, name) for name in ("kind", "weight", "is_prescribed")}
    fields = {name: value for name, value in fields.items() if getattr(group, name) != value}
    same = not fields and target is group.target and turn is group.turn
    return group if same else replace(group, target=target, turn=turn, **fields)


def _same(a: np.ndarray, b: np.ndarray, size: float) -> bool:
    """Whether arrays are equal up to rounding."""
    return a.shape == b.shape and bool(np.abs(a - b).max() <= SAME * size)


def _partly(
    rest: np.ndarray, influence: np.ndarray | None, R: np.ndarray, centre: np.ndarray, move: np.ndarray
) -> np.ndarray:
    """Return the positions after parts of a rotation about a centre and of a move, influence (k,)."""
    from scipy.spatial.transform import Rotation

    assert influence is not None
    part = influence[:, None]
    if np.array_equal(R, np.eye(3)):
        return rest + part * move
    turns = Rotation.from_rotvec(part * Rotation.from_matrix(R).as_rotvec())
    return turns.apply(rest - centre) + centre + part * move
