"""Landmark files of other programs: each kind, pairs of kinds, correspondence by name, and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from sshade.files.landmarks import read_landmarks

NAMES = ["nasion", "left eye", "right eye", "chin"]
POINTS = np.array([[0.1, -2, 3], [1, 0.5, 0], [0, 0, 1e-3], [7, 8, 9]])
MIRROR = np.array([-1.0, -1, 1])


def markups(points, names, system="LPS", status="defined") -> str:
    marks = [
        {"id": "1", "label": name, "position": list(point), "positionStatus": status}
        for name, point in zip(names, points, strict=True)
    ]
    return json.dumps({"markups": [{"coordinateSystem": system, "controlPoints": marks}]})


def fiducials(points, names, system="LPS", columns="id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc") -> str:
    rows = [f"# CoordinateSystem = {system}", f"# columns = {columns}"]
    for (x, y, z), name in zip(np.asarray(points).tolist(), names, strict=True):
        own = {"x": repr(x), "y": repr(y), "z": repr(z), "label": f'"{name}"'}
        rows.append(",".join(own.get(column, "0") for column in columns.split(",")))
    return "\n".join(rows) + "\n"


def picked(points, names) -> str:
    marks = [(*point, 1, name) for point, name in zip(points, names, strict=True)]
    rows = ['<point x="{}" y="{}" z="{}" active="{}" name="{}"/>'.format(*mark) for mark in marks]
    rows.append('<point x="0" y="0" z="0" active="0" name="not picked"/>')
    return f"<!DOCTYPE PickedPoints>\n<PickedPoints>{''.join(rows)}</PickedPoints>"


def lines(points, names=None, separator=" ", head="") -> str:
    rows = [separator.join(map(repr, map(float, point))) for point in points]
    rows = rows if names is None else [f"{n}{separator}{row}" for n, row in zip(names, rows, strict=True)]
    return head + "\n".join(rows) + "\n"


def comma(text: str) -> str:
    """Return a text with decimal commas."""
    return text.replace(".", ",")


NAMED = np.column_stack([POINTS.astype(str), NAMES])
#: Contents of files with all four landmarks, whether they have names, and their coordinate systems.
FILES = {
    "a.mrk.json": (markups(POINTS, NAMES), True, "LPS"),
    "RAS.MRK.JSON": (markups(POINTS * MIRROR, NAMES, "RAS"), True, "RAS"),
    "a.fcsv": (fiducials(POINTS, NAMES), True, "LPS"),
    "old.fcsv": (fiducials(POINTS * MIRROR, NAMES, "0", "label,x,y,z,sel,vis"), True, "RAS"),
    "a.pp": (picked(POINTS, NAMES), True, None),
    "a.particles": (lines(POINTS), False, None),
    "a.txt": ("# x y z\n\n" + lines(POINTS, separator="\t"), False, None),
    "named.txt": (lines(POINTS, [name.replace(" ", "_") for name in NAMES]), True, None),
    "a.csv": (lines(POINTS, NAMES, ", "), True, None),
    "bom.csv": ("\ufeff" + lines(POINTS, NAMES, ";", "name;x;y;z\n"), True, None),
    "columns.csv": ("x,y,z,Label\n" + "\n".join(map(",".join, NAMED)), True, None),
    "excel.csv": (comma("name;x;y;z\n" + lines(POINTS, NAMES, ";")) + ";;;\n", True, ""),
    "commas.txt": (comma(lines(POINTS)), False, ""),
    "tabs.txt": (comma(lines(POINTS, NAMES, "\t")), True, ""),
    "german.csv": (comma(lines(POINTS, separator=";")), False, ""),
    "quoted.csv": ("\n".join(f'"{n}","{x}","{y}","{z}"' for x, y, z, n in NAMED), True, ""),
    "bare.csv": (lines(POINTS, separator=",", head="X,Y,Z\n"), False, None),
}


def in_file(name: str) -> np.ndarray:
    """Return the positions as they are in a file."""
    return POINTS * MIRROR if FILES[name][2] == "RAS" else POINTS


@pytest.mark.parametrize("name", FILES)
def test_each_kind_is_read_with_names_and_numbers_as_they_are(here, name):
    content, named, _ = FILES[name]
    Path(name).write_text(content, encoding="utf-8")
    Path("b.particles").write_text(lines(POINTS + 1))
    names, source, target, _ = read_landmarks(Path(name), Path("b.particles"))
    assert [own.replace("_", " ") for own in names] == (NAMES if named else [""] * 4)
    assert np.array_equal(source, in_file(name)) and np.array_equal(target, POINTS + 1)


SYSTEMS = ["a.mrk.json", "RAS.MRK.JSON", "old.fcsv", "a.csv"]


@pytest.mark.parametrize("rest", SYSTEMS)
@pytest.mark.parametrize("target", SYSTEMS)
def test_a_target_is_converted_if_both_files_have_systems_and_they_differ(here, rest, target):
    for name in (rest, target):
        Path(name).write_text(FILES[name][0])
    _, source, found, _ = read_landmarks(Path(rest), Path(target))
    known = FILES[rest][2] and FILES[target][2]
    assert np.array_equal(source, in_file(rest))
    assert np.array_equal(found, source if known else in_file(target))
