"""Landmark files of other programs: each kind, pairs of kinds, correspondence by name, and refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import sshade
from sshade import InputError
from sshade.cli.main import main
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


def test_landmarks_correspond_by_name_if_both_files_have_names(here):
    Path("target.csv").write_text(lines(POINTS[::-1], NAMES[::-1], ","))
    for rest, found in (("a.csv", POINTS), ("bare.csv", POINTS[::-1])):
        Path(rest).write_text(FILES[rest][0])
        assert np.array_equal(read_landmarks(Path(rest), Path("target.csv"))[2], found)


def test_two_landmark_files_deform_a_mesh(sound, capsys):
    V, F = sshade.read("body.ply")
    chosen = np.array([0, 5, 20, 30])
    target = V[chosen] + [[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0.05, 0]]
    Path("rest.mrk.json").write_text(markups(V[chosen].tolist(), NAMES))
    Path("target.fcsv").write_text(fiducials((target * MIRROR)[::-1], NAMES[::-1], "RAS"))
    line = ["body.ply", "rest.mrk.json", "target.fcsv"]
    assert main(["deform", *line, "-o", "out.ply", "--vertices", "60"]) == 0
    assert "4 handles on target" in capsys.readouterr().err
    np.testing.assert_allclose(sshade.read("out.ply").V[chosen], target, rtol=0, atol=1e-12)
    assert main(["show", *line, "out.ply", "-o", "page.html"]) == 0
    handles = sshade.read_handles("rest.mrk.json", sshade.Mesh(V, F), target="target.fcsv")
    assert np.array_equal(handles.index, chosen) and handles.group.tolist() == [0, 1, 2, 3]
    assert handles.dynamic.tolist() == [True, False, False, True]


def test_landmarks_that_wait_to_be_placed_in_both_files_are_skipped(here):
    for name, points in (("a.mrk.json", POINTS), ("b.mrk.json", POINTS + 1)):
        marks = json.loads(markups(points, NAMES))
        for mark in marks["markups"][0]["controlPoints"][1:3]:
            mark |= {"positionStatus": "undefined", "position": [0, 0, 0]}
        Path(name).write_text(json.dumps(marks))
    names, source, target, _ = read_landmarks(Path("a.mrk.json"), Path("b.mrk.json"))
    assert names == [NAMES[0], NAMES[3]] and np.array_equal(source, POINTS[[0, 3]])
    assert np.array_equal(target, POINTS[[0, 3]] + 1)
    Path("none.mrk.json").write_text(markups(POINTS, NAMES, status="undefined"))
    with pytest.raises(InputError, match=r"none.mrk.json: it has no landmarks"):
        read_landmarks(Path("none.mrk.json"), Path("none.mrk.json"))
    with pytest.raises(InputError, match="none.mrk.json: landmark 0 'nasion' has no position, which b"):
        read_landmarks(Path("none.mrk.json"), Path("b.mrk.json"))


#: Content of the target beside a sound file a.csv of the rest shape, and words of the refusal.
BAD = {
    "short.csv": (lines(POINTS[:3], NAMES[:3], ","), "a.csv has 4 landmarks, and short.csv has 3; each"),
    "other.csv": (lines(POINTS, "abcd", ","), "there is no landmark 'nasion', which a.csv has"),
    "twice.csv": (lines(POINTS, "aacd", ","), "twice.csv: two landmarks have the name 'a'"),
    "nan.csv": ("chin,nan,0,0\n", "nan.csv: landmark 0 'chin' has a NaN or infinite position"),
    "word.txt": ("1 2 z\n", "word.txt: landmark 0 has no position of three numbers"),
    "few.csv": ("name,x,y,z\nnasion,1,2\n", "few.csv: landmark 0 has 3 values"),
    "none.csv": ("# nothing\n", "none.csv: it has no landmarks"),
    "broken.pp": ("<PickedPoints>", "broken.pp: not a readable landmark file (no element found"),
    "roi.mrk.json": ('{"markups": [{}]}', "not a readable landmark file (it has no 'controlPoints')"),
    "unset.mrk.json": (markups(POINTS, NAMES, status="undefined"), "landmark 0 'nasion' has no position"),
    "ijk.fcsv": (fiducials(POINTS, NAMES, "2"), "the coordinate system '2' is unknown; use LPS or RAS"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_landmarks_are_refused_in_one_sentence(here, name):
    content, words = BAD[name]
    Path("a.csv").write_text(FILES["a.csv"][0])
    Path(name).write_text(content)
    with pytest.raises(InputError, match=rf"\A[^\n]*{re.escape(words)}[^\n]*\Z"):
        read_landmarks(Path("a.csv"), Path(name))


@pytest.mark.parametrize("files", ["a.csv", "a.csv a.csv a.csv", "pose.json a.csv"])
def test_landmark_files_come_in_pairs(sound, files, capsys):
    Path("a.csv").write_text(FILES["a.csv"][0])
    assert main(f"deform body.ply {files} -o out_%02d.ply".split()) == 2
    assert "two landmark files (.csv, .txt, .mrk.json, .fcsv, .pp, .particles)" in capsys.readouterr().err
