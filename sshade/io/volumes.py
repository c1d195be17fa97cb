"""Volume goals in handle files: the list ``volumes``.

::

    {"handles": [...],
     "volumes": [
        {"name": "belly", "boxes": [[[x, y, z], [x, y, z]]], "goal": 1.2},
        {"name": "lung", "faces": [4, 5, 6], "volume": 0.004},
        {"goal": 1.05}
     ]}

An entry names a part by its ``faces``, by the ``vertices`` of its faces, or by ``boxes`` around its faces; a
face belongs to the part if all of its corners do. Without any of the three it stands for the whole mesh. Its
``goal`` is a multiple of the volume at rest, its ``volume`` a volume in the unit of length, cubed. See
:class:`sshade.VolumeGoal`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.files import naming
from sshade.io.keys import require_known
from sshade.io.points import as_boxes, as_ids
from sshade.io.regions import vertices_in
from sshade.volume_goals import VolumeGoal, check_goals

if TYPE_CHECKING:
    from sshade.mesh.surface import Surface

#: Keys that give the faces of a part, and functions that check their values.
WAYS = {"faces": as_ids, "vertices": as_ids, "boxes": as_boxes}
#: Keys of an entry.
KEYS = ("name", *WAYS, "goal", "volume")


class VolumeEntry(NamedTuple):
    """A volume goal of a file, before the mesh is known.

    Attributes
    ----------
    goal : VolumeGoal
        Without faces.
    way : str
        Key of :data:`WAYS` that gives the faces; empty for the whole mesh.
    place : (k,) int64 or (b, 2, 3) float64
        Ids, or the lowest and highest corners of boxes.
    """

    goal: VolumeGoal
    way: str
    place: np.ndarray


def volume_entries(data: Any) -> list[VolumeEntry]:
    """Check the list ``volumes`` of a file.

    Raises
    ------
    InputError
        On an unknown key, a goal that is not positive, or faces that are given twice or in another form.
    """
    if not isinstance(data, list) or not all(isinstance(entry, dict) for entry in data):
        raise InputError('"volumes" must be a list of objects with a "goal" or a "volume"')
    found = []
    for number, entry in enumerate(data):
        with naming(f"volume {number}"):
            require_known(entry, KEYS)
            ways = [key for key in WAYS if key in entry]
            if len(ways) > 1:
                raise InputError(f'give its faces either as "{ways[0]}" or as "{ways[1]}"')
            way, place = "".join(ways), np.empty(0, dtype=np.int64)
            if way:
                place = WAYS[way](entry[way], f'"{way}"')
            goal = VolumeGoal(entry.get("goal"), entry.get("volume"), name=str(entry.get("name", "")))
            found.append(VolumeEntry(goal, way, place))
    return found


def volumes_on_surface(
    entries: Sequence[VolumeEntry], whole: Surface, F: np.ndarray
) -> tuple[VolumeGoal, ...]:
    """Place the volume goals of a file on its mesh.

    Parameters
    ----------
    entries : sequence of VolumeEntry
    whole : Surface
        Made from the file of the mesh.
    F : (m, 3) int
        Triangles of the file of the mesh, to which the ids of faces refer.

    Raises
    ------
    InputError
        When a part has no face, or an id is out of range.
    """
    goals = []
    for number, (goal, way, place) in enumerate(entries):
        with naming(f"volume {number}"):
            goals.append(_with_faces(goal, way, place, whole, F))
    return check_goals(goals, whole.mesh.m)


def _with_faces(goal: VolumeGoal, way: str, place: np.ndarray, whole: Surface, F: np.ndarray) -> VolumeGoal:
    """Return a goal with the faces of the mesh."""
    if not way:
        return goal
    if way == "faces":
        named = VolumeGoal(goal.ratio, goal.volume, place, goal.name)
        return whole.goals(check_goals([named], len(F)), F)[0]
    inside = np.zeros(whole.mesh.n, dtype=bool)
    if way == "boxes":
        inside[vertices_in(whole.mesh.V, place)] = True
    else:
        outside = place[(place < 0) | (place >= len(whole.vertex))]
        if len(outside):
            raise InputError(f"vertex ids must lie in 0..{len(whole.vertex) - 1}, not {outside[0]}")
        at = whole.vertex[place]
        inside[at[at >= 0]] = True
    faces = np.flatnonzero(inside[whole.mesh.F].all(axis=1))
    return VolumeGoal(goal.ratio, goal.volume, faces, goal.name)
