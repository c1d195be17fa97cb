"""Keys of an animation: poses of the groups at some times, and the poses in between."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sshade.edit.following import followed, rotation_of
from sshade.edit.groups import Group
from sshade.io.points import packed
from sshade.mesh.mesh import Mesh

#: Longest animation in seconds, and largest number of its frames.
LONGEST, MOST = 600.0, 10_000


@dataclass(frozen=True, eq=False)
class Key:
    """A pose at a time.

    Parameters
    ----------
    time : float
        In seconds.
    groups : tuple of Group
    """

    time: float
    groups: tuple[Group, ...]


def posed(mesh: Mesh, groups: tuple[Group, ...], keys: Sequence[Key], time: float) -> tuple[Group, ...]:
    """Return groups as keys, ascending, pose them at a time.

    Between two keys, a group turns about its middle at a constant speed, by the shorter way, and its middle
    moves along a line. Before the first key and after the last one the groups stay. A group that a key lacks
    is at rest there.
    """
    at = bisect_right([key.time for key in keys], time)
    first, second = keys[max(at - 1, 0)], keys[min(at, len(keys) - 1)]
    part = (time - first.time) / (second.time - first.time) if second.time > first.time else 0.0
    made = []
    for group in groups:
        if group.link is None:
            turned = any(_at(mesh, group, key).turn is not None for key in keys)
            a, b = _at(mesh, group, first), _at(mesh, group, second)
            group = _between(mesh, a, b, part) if 0 < part < 1 else (a if part <= 0 else b)
            if turned and group.turn is None:
                group = replace(group, turn=np.eye(3))
        made.append(group)
    return followed(mesh, tuple(made))


def frame_times(keys: Sequence[Key], rate: float) -> list[float]:
    """Return the times of all keys, and `rate` times a second between the first key and the last one."""
    times = [key.time for key in keys]
    if rate > 0:
        count = int((times[-1] - times[0]) * rate + 1e-9)
        between = [times[0] + k / rate for k in range(count + 1)]
        times += [t for t in between if min(abs(t - time) for time in times) > 1e-6]
    return sorted(times)


def frames_of(
    mesh: Mesh, groups: tuple[Group, ...], keys: Sequence[Key], *, names: Sequence[str], rate: float
) -> list[dict[str, Any]]:
    """Return the frames of an animation for a file: see :mod:`sshade.io.poses`.

    Parameters
    ----------
    mesh : Mesh
    groups : tuple of Group
        Groups as the file has them. A frame has the groups that are elsewhere or turn differently.
    keys : sequence of Key
    names : sequence of str
        Different names of the groups.
    rate : float
        Frames per second; see :func:`frame_times`.
    """
    frames = []
    for time in frame_times(keys, rate):
        entries: list[dict[str, Any]] = []
        for name, group, moved in zip(names, groups, posed(mesh, groups, keys, time), strict=True):
            a, b = group.rotation, moved.rotation
            same = a is b or (a is not None and b is not None and np.array_equal(a, b))
            if same and np.array_equal(group.target, moved.target):
                continue
            entry: dict[str, Any] = {"landmark": name}
            entry |= {} if moved.is_free else {"target": packed(moved.target)}
            entry |= {} if b is None else {"rotation": b.tolist()}
            entries.append(entry)
        frames.append({"time": time, "handles": entries})
    return frames


def unique(names: Sequence[str]) -> list[str]:
    """Return different names, because frames name groups."""
    made: list[str] = []
    for name in names:
        number, new = 2, name
        while new in made:
            number, new = number + 1, f"{name} {number}"
        made.append(new)
    return made


def _at(mesh: Mesh, group: Group, key: Key) -> Group:
    """Return a group where a key has it."""
    old = next((one for one in key.groups if one.number == group.number), None)
    if old is None:
        return replace(group, target=mesh.V[group.vertices], turn=None)
    if old.vertices is group.vertices:
        return replace(group, target=old.target, turn=old.turn)
    target = mesh.V[group.vertices]
    _, own, theirs = np.intersect1d(group.vertices, old.vertices, return_indices=True)
    target[own] = old.target[theirs]
    return replace(group, target=target, turn=old.turn)


def _between(mesh: Mesh, a: Group, b: Group, part: float) -> Group:
    """Interpolate two places of a group: rotations on the shortest arc, everything else along lines."""
    from scipy.spatial.transform import Rotation, Slerp

    if np.array_equal(a.target, b.target) and a.turn is b.turn:
        return a
    rest = mesh.V[a.vertices]
    rest = rest - rest.mean(axis=0)
    ends = [rotation_of(mesh, one) for one in (a, b)]
    R = Slerp([0, 1], Rotation.from_matrix(ends))(part).as_matrix()
    turned = [one.target - rest @ end.T for one, end in zip((a, b), ends, strict=True)]
    target = rest @ R.T + (1 - part) * turned[0] + part * turned[1]
    if a.turn is None and b.turn is None:
        return replace(a, target=target)
    turns = [np.eye(3) if one.turn is None else one.turn for one in (a, b)]
    return replace(a, target=target, turn=Slerp([0, 1], Rotation.from_matrix(turns))(part).as_matrix())
