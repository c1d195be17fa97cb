"""Read handle files: this project's JSON and the YAML of Implicit-ARAP, with all checks that need no mesh.

JSON::

    {"handles": [
        {"name": "left foot", "kind": "fixed", "vertices": [12, 13, 14]},
        {"name": "right hand", "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
        {"name": "head", "boxes": [[[x, y, z], [x, y, z]], ...],
         "rotation": [[...], [...], [...]], "translation": [x, y, z], "scale": s, "center": "centroid"},
        {"name": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}
    ]}

Each entry is a group of handles, given in one of three ways:

- ``vertices``: ids of vertices of the mesh.
- ``source``: positions, which are snapped to the nearest vertices.
- ``boxes``: all vertices in some axis-aligned boxes, each with its lowest and its highest corner.

``kind`` is ``fixed`` (the handles stay at rest and need no target), ``moved`` or ``unused`` (the entry is
skipped). Without a ``kind``, an entry with a motion is moved. A motion is given in one of two ways:

- ``target``: the position of each handle.
- ``translation`` t, ``rotation`` R and ``scale`` s, or some of them: a vertex v moves to s R (v - c) + c + t.
  The ``center`` c is a point or ``"centroid"``, the mean of the places of the vertices, of which copies along
  a seam have one; by default it is the origin.

A ``rotation`` beside ``vertices`` or ``source`` that have a ``target``, or neither a motion nor the kind
``moved``, prescribes the rotation of the surface at the handles. A rotation is a matrix of three rows, or
a unit quaternion [x, y, z, w], as in glTF. A group with a ``weight`` is soft: it is pulled to its targets
(:class:`sshade.Handles`).

``landmark``, ``static`` and ``dynamic`` are other words for ``name``, ``fixed`` and ``moved``. Unknown keys
are refused. Keys that begin with ``_`` are ignored, as are keys that this project records.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import naming
from sshade.files.implicit_arap import read_implicit_arap
from sshade.files.json_yaml import (
    LONGEST,
    as_array,
    as_boxes,
    as_ids,
    as_points,
    parsed_list,
    require_known,
)
from sshade.files.landmarks import ENDINGS, read_landmarks
from sshade.files.mesh_file import between, check_input
from sshade.problem.handle_checks import NO_HANDLES, require_rotations
from sshade.problem.similarity import Similarity

#: Suffixes of handle files.
FORMATS = (".json", ".yaml", ".yml")
#: Keys of which an entry has one: they say where its handles are. Functions check their values.
PLACES = {"vertices": as_ids, "source": as_points, "boxes": as_boxes}
#: Keys that give the motion of a group without targets.
MOTION = ("rotation", "scale", "translation")
#: Keys of the name of a group.
NAMES = ("name", "landmark")
#: Words for a kind, and whether the handles move.
KINDS = {"fixed": False, "moved": True, "static": False, "dynamic": True}
#: Keys of an entry.
KEYS = (*NAMES, "kind", *PLACES, "target", *MOTION, "center", "weight")
#: Keys that this project writes into entries and files, and that readers of handles ignore.
RECORDS, FILE_RECORDS = ("delta", "delta_mean"), ("source_pose", "made")
#: Greatest accepted difference between the length of a quaternion and 1; files round to a few digits.
UNIT = 1e-3
#: Largest amount of the way that handles move.
FARTHEST = 2


@dataclass(frozen=True, eq=False)
class HandleGroup:
    """A group of handles. One of `vertices`, `source` and `boxes` says where they are.

    Attributes
    ----------
    number : int
        Place of the group in the file.
    name : str
        Empty if the group has none.
    moves : bool
        False if the group is fixed.
    vertices : (k,) int64, optional
        Ids of vertices.
    source : (k, 3) float64, optional
        Positions, which are snapped to vertices.
    boxes : (b, 2, 3) float64, optional
        Lowest and highest corners of boxes.
    target : (k, 3) float64, optional
        None for handles that stay, and for groups that move rigidly.
    motion : Similarity, optional
        Motion of a group that moves rigidly.
    rotation : (3, 3) float64, optional
        Prescribed rotation of the surface.
    weight : float
        inf for hard handles.
    """

    number: int
    name: str
    moves: bool
    vertices: np.ndarray | None = None
    source: np.ndarray | None = None
    boxes: np.ndarray | None = None
    target: np.ndarray | None = None
    motion: Similarity | None = None
    rotation: np.ndarray | None = None
    weight: float = np.inf

    @property
    def title(self) -> str:
        """How messages name the group, such as ``entry 0 "foot"``."""
        return _title(self.number, self.name)


@dataclass(frozen=True, eq=False)
class HandleFile:
    """A handle file that was read and checked. :func:`sshade.files.open_shape.on_mesh` places it.

    Attributes
    ----------
    groups : tuple of HandleGroup
        Without unused groups; at least one.
    raw : bool
        Whether targets stay as the file has them; see :meth:`sshade.Handles.from_positions`.
    implicit_arap : bool
        Whether positions are in the coordinates of Implicit-ARAP.
    made : mapping
        Options that the editor recorded.
    amount : float
        Fraction of the way that the handles move.
    spaces : (str, str)
        Coordinate systems, LPS or RAS, that landmark files of the rest shape and of the target declare.
    """

    groups: tuple[HandleGroup, ...]
    raw: bool
    implicit_arap: bool = False
    made: Mapping[str, Any] = field(default_factory=dict)
    amount: float = 1.0
    spaces: tuple[str, str] = ("", "")

    def in_space(self, space: str) -> HandleFile:
        """Convert landmarks to the coordinate system of a mesh. Where one of both is unknown, they stay."""
        groups = list(self.groups)
        if any(self.spaces):
            of_rest, of_target = (between(own, space) for own in self.spaces)
            for i, group in enumerate(groups):
                source, target = group.source * of_rest, group.target * of_target
                moves = bool((source != target).any())
                groups[i] = replace(group, source=source, target=target, moves=moves)
        return replace(self, groups=tuple(groups))


def pose_files(paths: Sequence[Path]) -> list[tuple[Path, ...]]:
    """Return the files of each pose for :func:`read_handle_file`: landmark files are one pose."""
    return [tuple(paths)] if any(map(is_landmark_file, paths)) else [(path,) for path in paths]


def is_landmark_file(path: str | os.PathLike[str]) -> bool:
    """Whether a file has the ending of landmark files."""
    return Path(path).name.lower().endswith(ENDINGS)


def read_handle_file(*paths: str | os.PathLike[str], raw: bool = False, amount: float = 1.0) -> HandleFile:
    """Read a handle file, or two landmark files, and check all that can be checked without the mesh.

    Raises
    ------
    InputError
        When a file is missing, of another format, or inconsistent, or `amount` is out of its range.
    """
    if not 0 <= amount <= FARTHEST:
        raise InputError(f"the amount goes from 0 to {FARTHEST}, not {amount:g}")
    kinds = list(map(is_landmark_file, paths))
    if kinds not in ([False], [True, True]):
        raise InputError(
            f"{paths[0]}: a pose is one handle file, or two landmark files ({', '.join(ENDINGS)}), of the "
            "rest shape and of the target"
        )
    read = _landmarks if kinds[0] else _handles
    return replace(read(*map(Path, paths), raw=raw), amount=amount)


def _landmarks(rest: Path, target: Path, *, raw: bool) -> HandleFile:
    """Read landmarks, each of which is a group."""
    *found, spaces = read_landmarks(rest, target)
    groups = [
        HandleGroup(number, name, bool((source != goal).any()), source=source[None], target=goal[None])
        for number, (name, source, goal) in enumerate(zip(*found, strict=True))
    ]
    return HandleFile(tuple(groups), raw, spaces=spaces)


def _handles(path: Path, *, raw: bool) -> HandleFile:
    """Read a file in this project's JSON, or in the YAML of Implicit-ARAP."""
    check_input(path, FORMATS)
    with naming(path):
        if path.suffix.lower() != ".json":
            parts = enumerate(read_implicit_arap(path))
            groups = [HandleGroup(k, "", goal is not None, source=at, target=goal) for k, (at, goal) in parts]
            return HandleFile(tuple(groups), raw, implicit_arap=True)
        data = parsed_list(path.read_bytes(), "handles")
        require_known(data, ("handles",), FILE_RECORDS)
        found = [_checked_group(number, entry, raw=raw) for number, entry in enumerate(data["handles"])]
        if not any(found):
            raise InputError(NO_HANDLES)
        made = data.get("made")
        return HandleFile(tuple(filter(None, found)), raw, made=made if isinstance(made, dict) else {})


def _title(number: int, name: str) -> str:
    """Return how messages name an entry of a handle file, such as ``entry 0 "foot"``."""
    return f"entry {number} {json.dumps(name, ensure_ascii=False)[:LONGEST]}" if name else f"entry {number}"


def _checked_group(number: int, entry: Any, *, raw: bool) -> HandleGroup | None:
    """Check an entry; None if it is unused.

    Targets and motions of handles that do not move are ignored unless `raw`.
    """
    with naming(f"entry {number}"):
        name = _name(entry)
    with naming(_title(number, name)):
        require_known(entry, KEYS, RECORDS)
        if entry.get("kind") == "unused":
            return None
        moves = _moves(entry)
        key = next(key for key in PLACES if key in entry)
        place = PLACES[key](entry[key], f'"{key}"')
        target, motion, rotation = None, None, None
        if "target" in entry and (raw or moves or "source" in entry):
            target = as_points(entry["target"], '"target"')
            if len(target) != len(place):
                has = counted(len(place), "handle has", "handles have")
                raise InputError(f"{has} {counted(len(target), 'target', 'targets')}; each needs one")
        if (raw or moves) and _moves_rigidly(entry, moves):
            motion = _motion(entry)
        elif "rotation" in entry and "boxes" not in entry:
            rotation = _rotation(entry)
        return HandleGroup(
            number,
            name,
            moves,
            vertices=place if key == "vertices" else None,
            source=place if key == "source" else None,
            boxes=place if key == "boxes" else None,
            target=target,
            motion=motion,
            rotation=rotation,
            weight=_weight(entry),
        )


def _moves_rigidly(entry: dict[str, Any], moves: bool) -> bool:
    """Whether a rotation, a translation or a scale is the motion of the group, and no prescribed rotation."""
    if "target" in entry or not any(key in entry for key in MOTION):
        return False
    return moves or any(key in entry for key in ("boxes", "translation", "scale", "center"))


def _motion(entry: dict[str, Any]) -> Similarity:
    """Return the motion of a group without targets."""
    rotation = _rotation(entry) if "rotation" in entry else np.eye(3)
    translation, center, scale = np.zeros(3), entry.get("center"), entry.get("scale", 1.0)
    if not _is_positive(scale) or np.isinf(scale):
        raise InputError('"scale" must be a number above 0')
    if "translation" in entry:
        translation = as_array(entry["translation"], '"translation"', (3,), "three numbers")
    if "center" in entry and center != "centroid":
        form = 'three numbers or "centroid"'
        if isinstance(center, str):
            raise InputError(f'"center" must be {form}, not {json.dumps(center[:LONGEST])}')
        center = as_array(center, '"center"', (3,), form)
    return Similarity(rotation, translation, center, float(scale))


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
        why = "its rows must have length 1 and be perpendicular, and its determinant be 1"
        raise InputError(f'"rotation" is no rotation: {why}') from error
    return R


def _weight(entry: dict[str, Any]) -> float:
    """Return the weight of an entry: inf for hard handles."""
    weight = entry.get("weight", np.inf)
    if not _is_positive(weight):
        raise InputError('"weight" must be a number above 0; leave it out for hard handles')
    return float(weight)


def _is_positive(value: Any) -> bool:
    """Whether a value is a number above 0 that a float can hold, or inf."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and value > 0 and not (isinstance(value, int) and value > 2**1000)


def _name(entry: Any) -> str:
    """Return the name of an entry; empty if it has none."""
    if not isinstance(entry, dict):
        raise InputError("it is no JSON object")
    name = next((entry[key] for key in NAMES if key in entry), "")
    if isinstance(name, bool) or not isinstance(name, str | int):
        raise InputError('"name" must be a name')
    return str(name)


def _moves(entry: dict[str, Any]) -> bool:
    """Return whether the handles of an entry move; check that it says where they are, and how they move."""
    if sum(key in entry for key in PLACES) != 1:
        raise InputError('give its handles either as "vertices", as "source" or as "boxes"')
    moves = any(key in entry for key in ("target", "translation", "scale"))
    moves = moves or ("rotation" in entry and ("boxes" in entry or "center" in entry))
    kind = entry.get("kind", "moved" if moves else "fixed")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"unknown kind {ascii(kind)[:LONGEST]}; use fixed, moved or unused")
    if "boxes" in entry and "target" in entry:
        raise InputError('"boxes" have no "target"; give a "rotation", a "scale" or a "translation"')
    for key in ("translation", "scale", "center"):
        if key in entry and "target" in entry:
            raise InputError(f'give the motion either as "target" or as "{key}"')
    if "center" in entry and "rotation" not in entry and "scale" not in entry:
        raise InputError('"center" needs a "rotation" or a "scale"')
    needed = MOTION if "boxes" in entry else ("target", *MOTION)
    if KINDS[kind] and not any(key in entry for key in needed):
        raise InputError(f"it is {kind} and has no {' or '.join(map(json.dumps, needed))}")
    return KINDS[kind]
