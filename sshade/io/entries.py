"""Handle files without their mesh: all checks that need no mesh, before anything is computed."""

from __future__ import annotations

import json
import os
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.document import check_input
from sshade.io.files import naming
from sshade.io.points import as_array, as_points

#: Suffixes of handle files.
FORMATS = (".json", ".yaml", ".yml")
#: Keys that give the handles of an entry.
WAYS = ("vertices", "source", "boxes")
#: Keys that give the motion of a region.
MOTION = {"rotation", "translation"}
#: All keys of an entry. Other keys are ignored, but not misspelt keys.
KEYS = ("landmark", "kind", *WAYS, "target", *sorted(MOTION), "weight")
#: Ratio of difflib from which on a key counts as a misspelling of another key.
ALIKE = 0.8
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
    way : str
        Key of :data:`WAYS` that gives the handles.
    place : (k,) int64, (k, 3) float64 or (b, 2, 3) float64
        Vertex ids, positions, or the lowest and highest corners of boxes.
    dynamic : bool
    target : (k, 3) float64, optional
        None for handles that stay, and for regions.
    rotation : (3, 3) float64
        Rotation of a region, or prescribed rotation of the surface; NaN without one.
    translation : (3,) float64, optional
        Of a region; None if the region stays.
    weight : float
        inf for hard handles.
    """

    number: int
    way: str
    place: np.ndarray
    dynamic: bool
    target: np.ndarray | None = None
    rotation: np.ndarray = NO_ROTATION
    translation: np.ndarray | None = None
    weight: float = np.inf


class HandleFile(NamedTuple):
    """A handle file that was read and checked; :func:`sshade.io.handles.on_mesh` places it on a mesh.

    Attributes
    ----------
    entries : list of Entry
        Without unused entries; at least one.
    raw : bool
        Whether targets stay as the file has them; see :meth:`sshade.Handles.from_positions`.
    implicit_arap : bool
        Whether positions are in the coordinates of Implicit-ARAP.
    """

    entries: list[Entry]
    raw: bool
    implicit_arap: bool = False


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
            return parsed_handle_file(path.read_bytes(), raw=raw)
        from sshade.io.implicit_arap import read_implicit_arap

        entries = [
            Entry(number, "source", points, dynamic, moved)
            for number, (points, moved, dynamic) in enumerate(read_implicit_arap(path))
        ]
        return HandleFile(entries, raw, implicit_arap=True)


def parsed_handle_file(content: bytes, *, raw: bool = False) -> HandleFile:
    """Check this project's JSON as :func:`read_handle_file` does."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"not readable as JSON ({why})") from error
    if not isinstance(data, dict) or not isinstance(data.get("handles"), list):
        raise InputError('expected an object with a list "handles"')
    entries = []
    for number, entry in enumerate(data["handles"]):
        with naming(f"entry {number}"):
            kind = _kind(entry)
            if kind != "unused":
                entries.append(_entry(number, entry, kind == "dynamic", moves=raw or kind == "dynamic"))
    if not entries:
        from sshade.handles import NO_HANDLES

        raise InputError(NO_HANDLES)
    return HandleFile(entries, raw)


def _entry(number: int, entry: dict[str, Any], dynamic: bool, *, moves: bool) -> Entry:
    """Check an entry. Targets and motions of handles that do not move are ignored."""
    weight = _weight(entry)
    if "boxes" in entry:
        boxes = as_array(entry["boxes"], '"boxes"', (None, 2, 3), "a list of pairs of points")
        if not (moves and set(entry) >= MOTION):
            return Entry(number, "boxes", boxes, dynamic, weight=weight)
        translation = as_array(entry["translation"], '"translation"', (3,), "three numbers")
        return Entry(number, "boxes", boxes, dynamic, None, _rotation(entry), translation, weight)
    by_id, target = "vertices" in entry, None
    place = _ids(entry["vertices"]) if by_id else as_points(entry["source"], '"source"')
    if "target" in entry and (moves or not by_id):
        target = as_points(entry["target"], '"target"')
        if len(target) != len(place):
            raise InputError(f"{len(place)} handles have {len(target)} targets; each needs one")
    rotation = _rotation(entry) if "rotation" in entry else NO_ROTATION
    return Entry(number, "vertices" if by_id else "source", place, dynamic, target, rotation, None, weight)


def _rotation(entry: dict[str, Any]) -> np.ndarray:
    """Return the rotation (3, 3) of an entry, given as a matrix or a quaternion."""
    form = "three rows of three numbers, or a quaternion [x, y, z, w]"
    if isinstance(entry["rotation"], list) and len(entry["rotation"]) == 4:
        quaternion = as_array(entry["rotation"], '"rotation"', (4,), form)
        if abs(np.linalg.norm(quaternion) - 1) > UNIT:
            raise InputError('"rotation" is no rotation: a quaternion has length 1')
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat(quaternion).as_matrix()
    R = as_array(entry["rotation"], '"rotation"', (3, 3), form)
    from sshade.handles import require_rotations

    with naming('"rotation" is no rotation'):
        require_rotations(R[None])
    return R


def _weight(entry: dict[str, Any]) -> float:
    """Return the weight of an entry: inf for hard handles."""
    weight = entry.get("weight", np.inf)
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not number or not weight > 0:
        raise InputError('"weight" must be a number above 0; leave it out for hard handles')
    return float(weight)


def _kind(entry: Any) -> str:
    """Return "static", "dynamic" or "unused", and check that the entry has the keys of that kind."""
    if not isinstance(entry, dict):
        raise InputError("it is no JSON object")
    if entry.get("kind") == "unused":
        return "unused"
    for key in entry.keys() - set(KEYS):
        if near := get_close_matches(key, KEYS, n=1, cutoff=ALIKE):
            raise InputError(f'there is no key "{key}"; did you mean "{near[0]}"?')
    moves = "target" in entry or ("boxes" in entry and MOTION & set(entry))
    kind = entry.get("kind", "dynamic" if moves else "static")
    if kind not in ("static", "dynamic"):
        raise InputError(f"unknown kind {kind!r}; use static, dynamic or unused")
    if sum(key in entry for key in WAYS) != 1:
        raise InputError('give its handles either as "vertices", as "source" or as "boxes"')
    needed = MOTION if "boxes" in entry else {"target"}
    if kind == "dynamic" and not needed <= set(entry):
        raise InputError(f'it is dynamic and has no "{min(needed - set(entry))}"')
    return kind


def _ids(values: Any) -> np.ndarray:
    """Return vertex ids (k,) of the file."""
    try:
        index = np.asarray(values)
    except ValueError:  # lists of several lengths
        index = np.zeros(0)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer):
        raise InputError('"vertices" must be a list of integers, at least one')
    return index
