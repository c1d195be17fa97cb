"""Landmark files of other programs: two of them, of the rest shape and of the target, are handles.

===============  ===============================================================
``.csv, .txt``   lines ``x y z`` or ``name, x, y, z``, with or without a head line
``.mrk.json``    markups of 3D Slicer
``.fcsv``        fiducials of earlier versions of 3D Slicer
``.pp``          picked points of MeshLab
``.particles``   particles of ShapeWorks
===============  ===============================================================
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import expecting, naming
from sshade.files.json_yaml import decoded, parsed_list
from sshade.files.mesh_file import between, check_input

#: Endings of landmark files.
ENDINGS = (".csv", ".txt", ".mrk.json", ".fcsv", ".pp", ".particles")
#: Names of the coordinate systems of 3D Slicer, as its files write them.
SYSTEMS = {"RAS": "RAS", "0": "RAS", "LPS": "LPS", "1": "LPS"}
#: The values of a line of a table.
ORDER = "x y z, or name, x, y, z"


class Landmark(NamedTuple):
    """A landmark as a file has it; `name` is empty if it has none, and coordinates may be texts.

    The position is None if the landmark waits to be placed.
    """

    name: str
    position: Any
    system: str = ""


class Landmarks(NamedTuple):
    """Landmarks of the rest shape and of the target.

    Attributes
    ----------
    names : list of str
        Empty where a landmark has no name.
    source, target : (k, 3) float64
        In one coordinate system, if both files declare theirs.
    spaces : (str, str)
        Their coordinate systems, LPS or RAS; empty where a file declares none.
    """

    names: list[str]
    source: np.ndarray
    target: np.ndarray
    spaces: tuple[str, str]


def read_landmarks(rest: Path, target: Path) -> Landmarks:
    """Read the landmarks of the rest shape and of the target.

    They correspond by their names if both files have names, and otherwise by their order. Landmarks that both
    files list without a position are skipped.

    Raises
    ------
    InputError
        When a file is missing or unreadable, or the landmarks do not correspond.
    """
    (names, source, space), (others, goal, its_space) = _read(rest), _read(target)
    k = counted(len(source), "landmark", "landmarks")
    if len(source) != len(goal):
        raise InputError(f"{rest} has {k}, and {target} has {len(goal)}; each needs a position in both files")
    if all(names) and all(others):
        row = {name: number for number, name in enumerate(others)}
        for name in names:
            if name not in row:
                raise InputError(
                    f"{target}: there is no landmark {name!r}, which {rest} has; give both files the same "
                    "names, or one of them none"
                )
        goal = goal[[row[name] for name in names]]
    names = names if any(names) else others
    placed = np.isfinite(source).all(axis=1)
    for number in np.flatnonzero(placed != np.isfinite(goal).all(axis=1)):
        without, has = (target, rest) if placed[number] else (rest, target)
        raise InputError(f"{without}: landmark {number} {names[number]!r} has no position, which {has} has")
    if not placed.any():
        raise InputError(f"{rest}: it has no landmarks")
    names, source, goal = [names[i] for i in np.flatnonzero(placed)], source[placed], goal[placed]
    if space and its_space:
        return Landmarks(names, source, goal * between(its_space, space), (space, space))
    return Landmarks(names, source, goal, (space, its_space))


def _read(path: Path) -> tuple[list[str], np.ndarray, str]:
    """Return the names (k) and positions (k, 3) of landmarks, and their coordinate system."""
    check_input(path, (path.suffix.lower(),))
    reader = {".json": _markups, ".fcsv": _fiducials, ".pp": _picked}.get(path.suffix.lower(), _table)
    with expecting("a readable landmark file", path), naming(path):
        found = list(reader(path.read_bytes()))
        unplaced = [np.nan] * 3
        positions = [
            unplaced if mark.position is None else _coordinates(number, mark)
            for number, mark in enumerate(found)
        ]
        names, systems = [mark.name for mark in found], {mark.system for mark in found}
        if not found:
            raise InputError("it has no landmarks")
        if len(systems) > 1:
            raise InputError("its landmarks are in two coordinate systems, LPS and RAS; save them in one")
        if twice := [name for name, count in Counter(filter(None, names)).items() if count > 1]:
            raise InputError(f"two landmarks have the name {twice[0]!r}")
        return names, np.array(positions), systems.pop()


def _coordinates(number: int, mark: Landmark) -> list[float]:
    """Return the position of a landmark; raise InputError unless it is three finite numbers."""
    title = f"landmark {number}" + (f" {mark.name!r}" if mark.name else "")
    try:
        x, y, z = map(float, mark.position)
    except (TypeError, ValueError) as error:
        raise InputError(f"{title} has no position of three numbers") from error
    if not np.isfinite([x, y, z]).all():
        raise InputError(f"{title} has a NaN or infinite position")
    return [x, y, z]


def _table(content: bytes) -> list[Landmark]:
    """Read lines of a position, with or without a name before it. The first line may name the columns.

    The separator is the first that splits all lines as expected. Where it is no comma, numbers may have
    decimal commas, as spreadsheets of many countries write them, beside lines of separators alone.
    """
    lines = [
        line for line in decoded(content).splitlines() if line.strip(" \t;,") and line.lstrip()[0] != "#"
    ]
    errors = []
    for separator in (*[sign for sign in ";\t," if any(sign in line for line in lines)], None):
        try:
            found = list(_marks(lines, separator))
            for number, mark in enumerate(found):
                _coordinates(number, mark)
            return found
        except InputError as error:
            errors.append(error)
    raise errors[0]


def _marks(lines: list[str], separator: str | None) -> Iterator[Landmark]:
    """Split lines at a separator, or at blanks if it is None."""
    rows = [*csv.reader(lines, delimiter=separator)] if separator else [line.split() for line in lines]
    head = [field.strip().lower() for field in rows[0]] if rows else []
    columns = head if {"x", "y", "z"} <= set(head) else []
    for number, row in enumerate(rows[bool(columns) :]):
        if len(row) not in ([len(columns)] if columns else [3, 4]):
            raise InputError(
                f"landmark {number} has {counted(len(row), 'value', 'values')}; expected {ORDER}"
            )
        fields = dict(zip(columns or ["name", "x", "y", "z"][-len(row) :], row, strict=True))
        name = next((fields[key] for key in ("name", "label", "landmark", "id") if key in fields), "")
        position = [fields[axis] for axis in "xyz"]
        if separator != ",":
            position = [value.replace(",", ".") for value in position]
        yield Landmark(name.strip(), position)


def _markups(content: bytes) -> Iterator[Landmark]:
    """Read the control points of all markups of 3D Slicer."""
    for markup in parsed_list(content, "markups")["markups"]:
        system = _system(markup.get("coordinateSystem", "LPS"))
        for point in markup["controlPoints"]:
            placed = point.get("positionStatus", "defined") == "defined"
            yield Landmark(str(point.get("label", "")), point["position"] if placed else None, system)


def _fiducials(content: bytes) -> Iterator[Landmark]:
    """Read the fiducials of earlier versions of 3D Slicer: a table behind lines of comments."""
    columns, system, rows = [], "RAS", []
    for line in decoded(content).splitlines():
        key, _, value = line.lstrip("# ").partition("=")
        if not line.startswith("#"):
            rows += [line] if line.strip() else []
        elif key.strip() == "columns":
            columns = [name.strip() for name in value.split(",")]
        elif key.strip() == "CoordinateSystem":
            system = _system(value.strip())
    for row in csv.reader(rows):
        fields = dict(zip(columns, row, strict=False))
        yield Landmark(fields.get("label", ""), [fields.get(axis) for axis in "xyz"], system)


def _system(name: object) -> str:
    if str(name) not in SYSTEMS:
        raise InputError(f"the coordinate system {str(name)!r} is unknown; use LPS or RAS")
    return SYSTEMS[str(name)]


def _picked(content: bytes) -> Iterator[Landmark]:
    """Read the points that were picked in MeshLab."""
    for point in ElementTree.fromstring(content).iter("point"):
        if point.get("active", "1") != "0":
            yield Landmark(point.get("name", ""), [point.get(axis) for axis in "xyz"])
