"""Move groups that follow other groups, and keep their links in files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sshade.edit.groups import Group
from sshade.edit.links import Link, middle, mirrored_slide, reflection
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion

#: Largest difference of equal positions, as a fraction of the diagonal, and of equal rotations.
SAME = 1e-12
#: Largest distance of a follower in a file from where its leader takes it, as a fraction of the diagonal. A
#: group farther away keeps its place and follows no longer: its leader lost vertices since they were linked.
FOLLOWS = 1e-6


def recorded(groups: Sequence[Group]) -> list[Any]:
    """Return the links of groups for a file: null, or the place of the leader and the axis."""
    place = {group.number: i for i, group in enumerate(groups)}
    return [one.link and [place[one.link.leader], one.link.axis] for one in groups]


def linked(mesh: Mesh, groups: tuple[Group, ...], record: Any) -> tuple[Group, ...]:
    """Return groups with the links of :func:`recorded`, or without links if another program changed the file.

    All groups stay at their targets.

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
            case [int(place), 0 | 1 | 2 as axis, *_] if 0 <= place < len(made):
                link = Link(made[place].number, axis, slide=made[place].slide)
        if link is not None:
            # The rotations of a file are prescribed; these come from the motion of the leader.
            place = entry[0]
            made[place] = replace(made[place], is_prescribed=False)
            moved = _follow(mesh, replace(group, is_prescribed=False, link=link), link, made[place])
            if np.abs(moved.target - group.target).max() <= FOLLOWS * mesh.diagonal:
                group = replace(group, is_prescribed=False, link=link)
        made.append(group)
    return tuple(made)


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


def rotation_of(mesh: Mesh, group: Group) -> np.ndarray:
    """Return the rotation (3, 3) by which a group turned from rest."""
    rotation = None if group.is_prescribed else group.rotation
    if rotation is not None:
        return rotation
    rest = mesh.V[group.vertices]
    return np.eye(3) if np.array_equal(group.target, rest) else rigid_motion(rest, group.target)[0]


def _follow(mesh: Mesh, group: Group, link: Link, leader: Group) -> Group:
    """Move a group as its leader moved."""
    rest, centre = mesh.V[group.vertices], mesh.V[leader.vertices].mean(axis=0)
    still, R = np.array_equal(leader.target, mesh.V[leader.vertices]), rotation_of(mesh, leader)
    move = leader.target.mean(axis=0) - centre
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
