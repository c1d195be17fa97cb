"""Handle files without their mesh: all checks that need no mesh, before anything is computed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.files.atomic import naming
from sshade.files.document import check_input
from sshade.files.keys import LONGEST, parsed_list, require_known
from sshade.files.points import as_array, as_boxes, as_ids, as_points
from sshade.files.regions import RigidMotion
from sshade.problem.handle_checks import NO_HANDLES, require_rotations

#: Suffixes of handle files.
FORMATS = (".json", ".yaml", ".yml")
#: Keys that give the handles of an entry, and functions that check their values.
WAYS = {"vertices": as_ids, "source": as_points, "boxes": as_boxes}
#: Keys that give the motion of a group without targets.
MOTION = {"rotation", "translation"}
#: Keys of an entry.
KEYS = ("landmark", "kind", *WAYS, "target", *sorted(MOTION), "center", "weight")
#: Keys that are refused, and the handles that had them.
REFUSED = {"slide": "handles that slide", "free": "rotations without a position"}
#: Keys of animations, which are refused.
ANIMATION = ("frames", "keys")
#: Keys that this project writes into entries and files, and that readers of handles ignore. "links" is in
#: files of earlier editors.
RECORDS, FILE_RECORDS = ("delta", "delta_mean"), ("source_pose", "made", "links")
#: Greatest accepted difference between the length of a quaternion and 1; files round to a few digits.
UNIT = 1e-3
#: Value for handles without a prescribed rotation.
NO_ROTATION = np.full((3, 3), np.nan)


class Entry(NamedTuple):
    """A group of handles.

    Attributes
    ----------
    number : int
        Place of the entry in the file.
    name : str
        Its landmark; empty if it has none.
    way : str
        Key of :data:`WAYS` that gives the handles.
    place : (k,) int64, (k, 3) float64 or (b, 2, 3) float64
        Vertex ids, positions, or the lowest and highest corners of boxes.
    dynamic : bool
    target : (k, 3) float64, optional
        None for handles that stay, and for groups that move rigidly.
    rotation : (3, 3) float64
        Prescribed rotation of the surface; NaN without one.
    motion : RigidMotion, optional
        Motion of a group that moves rigidly.
    weight : float
        inf for hard handles.
    """

    number: int
    name: str
    way: str
    place: np.ndarray
    dynamic: bool
    target: np.ndarray | None = None
    rotation: np.ndarray = NO_ROTATION
    motion: RigidMotion | None = None
    weight: float = np.inf


class HandleFile(NamedTuple):
    """A handle file that was read and checked; :func:`sshade.files.handles.on_mesh` places it on a mesh.

    Attributes
    ----------
    entries : list of Entry
        Without unused entries; at least one.
    raw : bool
        Whether targets stay as the file has them; see :meth:`sshade.Handles.from_positions`.
    implicit_arap : bool
        Whether positions are in the coordinates of Implicit-ARAP.
    made : mapping
        Options that the editor recorded.
    """

    entries: list[Entry]
    raw: bool
    implicit_arap: bool = False
    made: Mapping[str, Any] = {}


def read_handle_file(path: str | os.PathLike[str], *, raw: bool = False) -> HandleFile:
    """Read a handle file, and check all that can be checked without the mesh.

    Raises
    ------
    InputError
        When the file is missing, of another format, or inconsistent.
    """
    path = Path(path)
    check_input(path, FORMATS)
    with naming(path):
        if path.suffix.lower() == ".json":
            data = parsed_list(path.read_bytes(), "handles")
            return handle_file_of(data, raw=raw)
        from sshade.files.implicit_arap import read_implicit_arap

        entries = [
            Entry(number, "", "source", points, dynamic, moved)
            for number, (points, moved, dynamic) in enumerate(read_implicit_arap(path))
        ]
        return HandleFile(entries, raw, implicit_arap=True)


def handle_file_of(data: dict[str, Any], *, raw: bool) -> HandleFile:
    """Check the object of this project's JSON as :func:`read_handle_file` does."""
    if "volumes" in data:
        raise InputError(
            'volume goals of parts ("volumes") are no longer supported; use the option volume_goal, which is '
            "the goal of the whole mesh"
        )
    for key in ANIMATION:
        if key in data:
            raise InputError(
                f'animations ("{key}") are no longer supported; use one handle file for each pose'
            )
    require_known(data, ("handles",), FILE_RECORDS)
    entries = []
    for number, entry in enumerate(data["handles"]):
        name = entry.get("landmark") if isinstance(entry, dict) else None
        with naming(entry_name(number, name if isinstance(name, str) else "")):
            if (checked := checked_entry(number, entry, raw=raw)) is not None:
                entries.append(checked)
    if not entries:
        raise InputError(NO_HANDLES)
    made = data.get("made")
    made = made if isinstance(made, dict) else {}
    return HandleFile(entries, raw, made=made)


def entry_name(number: int, name: str) -> str:
    """Return how messages name an entry of a handle file, such as ``entry 0 "foot"``."""
    return f"entry {number} {json.dumps(name, ensure_ascii=False)[:LONGEST]}" if name else f"entry {number}"


def checked_entry(number: int, entry: Any, *, raw: bool) -> Entry | None:
    """Check an entry; None if it is unused.

    Targets and motions of handles that do not move are ignored.
    """
    if (kind := _kind(entry)) == "unused":
        return None
    dynamic = kind == "dynamic"
    moves = raw or dynamic
    name = entry.get("landmark", "")
    if isinstance(name, bool) or not isinstance(name, str | int):
        raise InputError('"landmark" must be a name')
    way = next(key for key in WAYS if key in entry)
    place = WAYS[way](entry[way], f'"{way}"')
    target, motion, rotation = None, None, NO_ROTATION
    if "target" in entry and (moves or way != "vertices"):
        target = as_points(entry["target"], '"target"')
        if len(target) != len(place):
            raise InputError(f"{len(place)} handles have {len(target)} targets; each needs one")
    if moves and _moves_rigidly(entry, dynamic):
        motion = _motion(entry)
    elif "rotation" in entry and way != "boxes":
        rotation = _rotation(entry)
    return Entry(number, str(name), way, place, dynamic, target, rotation, motion, _weight(entry))


def _moves_rigidly(entry: dict[str, Any], dynamic: bool) -> bool:
    """Whether a rotation or a translation is the motion of the group, and no prescribed rotation."""
    if "target" in entry or not MOTION & set(entry):
        return False
    return dynamic or "boxes" in entry or "translation" in entry or "center" in entry


def _motion(entry: dict[str, Any]) -> RigidMotion:
    """Return the motion of a group without targets."""
    rotation = _rotation(entry) if "rotation" in entry else np.eye(3)
    translation, center = np.zeros(3), entry.get("center")
    if "translation" in entry:
        translation = as_array(entry["translation"], '"translation"', (3,), "three numbers")
    if "center" in entry and center != "centroid":
        form = 'three numbers or "centroid"'
        if isinstance(center, str):
            raise InputError(f'"center" must be {form}, not {json.dumps(center[:LONGEST])}')
        center = as_array(center, '"center"', (3,), form)
    return RigidMotion(rotation, translation, center)


def _rotation(entry: dict[str, Any]) -> np.ndarray:
    """Return the rotation (3, 3) of an entry, given as a matrix or a quaternion."""
    form = "three rows of three numbers, or a quaternion [x, y, z, w]"
    if isinstance(entry["rotation"], list) and len(entry["rotation"]) == 4:
        quaternion = as_array(entry["rotation"], '"rotation"', (4,), form)
        if abs(np.linalg.norm(quaternion) - 1) > UNIT:
            length = f"{np.linalg.norm(quaternion):.4g}"
            raise InputError(f'"rotation" is no rotation: a quaternion has length 1, not {length}')
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat(quaternion).as_matrix()
    R = as_array(entry["rotation"], '"rotation"', (3, 3), form)
    try:
        require_rotations(R[None])
    except InputError as error:
        why = "its rows must have length 1 and be perpendicular"
        why = "it mirrors; its determinant must be 1" if np.linalg.det(R) < 0 else why
        raise InputError(f'"rotation" is no rotation: {why}') from error
    return R


def _weight(entry: dict[str, Any]) -> float:
    """Return the weight of an entry: inf for hard handles."""
    weight = entry.get("weight", np.inf)
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not number or not weight > 0 or (isinstance(weight, int) and weight > 2**1000):
        raise InputError('"weight" must be a number above 0; leave it out for hard handles')
    return float(weight)


def _kind(entry: Any) -> str:
    """Return "static", "dynamic" or "unused", and check that the entry has the keys of that kind."""
    if not isinstance(entry, dict):
        raise InputError("it is no JSON object")
    for key, what in REFUSED.items():
        if key in entry:
            raise InputError(
                f'{what} ("{key}") are no longer supported; use a soft handle, with a target and a "weight"'
            )
    require_known(entry, KEYS, RECORDS)
    if entry.get("kind") == "unused":
        return "unused"
    moves = "target" in entry or "translation" in entry
    moves = moves or ("rotation" in entry and ("boxes" in entry or "center" in entry))
    kind = entry.get("kind", "dynamic" if moves else "static")
    if kind not in ("static", "dynamic"):
        raise InputError(f"unknown kind {ascii(kind)[:LONGEST]}; use static, dynamic or unused")
    if sum(key in entry for key in WAYS) != 1:
        raise InputError('give its handles either as "vertices", as "source" or as "boxes"')
    _check_motion(entry, kind)
    return kind


def _check_motion(entry: dict[str, Any], kind: str) -> None:
    """Raise InputError unless the entry gives one motion, or none."""
    needed = ["rotation", "translation"] if "boxes" in entry else ["target", "rotation", "translation"]
    if "boxes" in entry and "target" in entry:
        raise InputError('"boxes" have no "target"; give a "rotation" or a "translation"')
    for key in ("translation", "center"):
        if key in entry and "target" in entry:
            raise InputError(f'give the motion either as "target" or as "{key}"')
    if "center" in entry and "rotation" not in entry:
        raise InputError('"center" needs a "rotation"')
    if kind == "dynamic" and not any(key in entry for key in needed):
        raise InputError(f"it is dynamic and has no {' or '.join(map(json.dumps, needed))}")
