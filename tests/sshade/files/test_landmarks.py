"""Landmark files of other programs: each kind, pairs of kinds, correspondence by name, and refusals."""

import json
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


def markups(points, names, system="LPS", **more) -> str:
    own = {"id": "1", "description": "", "selected": True, "positionStatus": "defined"}
    marks = [{**own, "label": n, "position": list(p), **more} for n, p in zip(names, points, strict=True)]
    about = {"type": "Fiducial", "coordinateSystem": system, "coordinateUnits": "mm", "controlPoints": marks}
    return json.dumps({"@schema": "markups-schema-v1.0.3.json#", "markups": [about]})


def fiducials(
    points, names, system="LPS", columns="id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
):
    rows = []
    for number, (point, name) in enumerate(zip(points, names, strict=True)):
        own = dict(zip("xyz", map(repr, map(float, point)), strict=True)) | {
            "label": f'"{name}"',
            "id": f"n_{number}",
        }
        rows.append(",".join(own.get(column, "0") for column in columns.split(",")))
    head = f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n# columns = {columns}\n"
    return head + "\n".join(rows) + "\n"


def picked(points, names) -> str:
    rows = [
        f'<point x="{p[0]}" y="{p[1]}" active="1" z="{p[2]}" name="{n}"/>'
        for p, n in zip(points, names, strict=True)
    ]
    head = '<!DOCTYPE PickedPoints>\n<PickedPoints><DocumentData><DateTime time="1"/></DocumentData>'
    rows.append('<point x="0" y="0" z="0" active="0" name="not picked"/>')
    return head + "".join(rows) + "</PickedPoints>"


def lines(points, names=None, separator=" ", head="") -> str:
    rows = [separator.join(map(repr, map(float, point))) for point in points]
    rows = rows if names is None else [f"{n}{separator}{row}" for n, row in zip(names, rows, strict=True)]
    return head + "\n".join(rows) + "\n"


NUMBERED = [name.replace(" ", "_") for name in NAMES]
#: Contents of files with all four landmarks, and whether they have names.
FILES = {
    "a.mrk.json": (markups(POINTS, NAMES), True),
    "RAS.MRK.JSON": (markups(POINTS * MIRROR, NAMES, "RAS"), True),
    "a.fcsv": (fiducials(POINTS, NAMES), True),
    "old.fcsv": (fiducials(POINTS * MIRROR, NAMES, "0", "label,x,y,z,sel,vis"), True),
    "a.pp": (picked(POINTS, NAMES), True),
    "a.particles": (lines(POINTS), False),
    "a.txt": ("# x y z\n\n" + lines(POINTS, separator="\t"), False),
    "named.txt": (lines(POINTS, NUMBERED), True),
    "a.csv": (lines(POINTS, NAMES, ", "), True),
    "bom.csv": ("\ufeff" + lines(POINTS, NAMES, ";", "name;x;y;z\n"), True),
    "columns.csv": (
        "x,y,z,Label\n" + "".join(f"{p[0]},{p[1]},{p[2]},{n}\n" for p, n in zip(POINTS, NAMES, strict=True)),
        True,
    ),
    "bare.csv": (lines(POINTS, separator=",", head="X,Y,Z\n"), False),
}


@pytest.mark.parametrize("name", FILES)
def test_each_kind_is_read_with_names_and_numbers_as_they_are(here, name):
    content, named = FILES[name]
    Path(name).write_text(content, encoding="utf-8")
    Path("b.particles").write_text(lines(POINTS + 1))
    names, source, target = read_landmarks(Path(name), Path("b.particles"))
    assert [own.replace("_", " ") for own in names] == (NAMES if named else [""] * 4)
    in_file = POINTS * MIRROR if "RAS" in name or "old" in name else POINTS
    assert np.array_equal(source, in_file) and np.array_equal(target, POINTS + 1)


#: Coordinate systems of files, and the positions as they are in the files.
SYSTEMS = {"a.mrk.json": "LPS", "RAS.MRK.JSON": "RAS", "a.fcsv": "LPS", "old.fcsv": "RAS", "a.csv": None}
IN_FILE = {name: POINTS * MIRROR if system == "RAS" else POINTS for name, system in SYSTEMS.items()}


@pytest.mark.parametrize("rest", SYSTEMS)
@pytest.mark.parametrize("target", SYSTEMS)
def test_a_target_is_converted_if_both_files_have_systems_and_they_differ(here, rest, target):
    Path(rest).write_text(FILES[rest][0])
    Path(target).write_text(FILES[target][0])
    _, source, found = read_landmarks(Path(rest), Path(target))
    known = SYSTEMS[rest] and SYSTEMS[target]
    assert np.array_equal(source, IN_FILE[rest])
    assert np.array_equal(found, source if known else IN_FILE[target])


def test_landmarks_correspond_by_name_if_both_files_have_names(here):
    Path("target.csv").write_text(lines(POINTS[::-1], NAMES[::-1], ","))
    for rest, found in (("a.csv", POINTS), ("bare.csv", POINTS[::-1])):
        Path(rest).write_text(FILES[rest][0])
        assert np.array_equal(read_landmarks(Path(rest), Path("target.csv"))[2], found)


def test_two_landmark_files_deform_a_mesh(sound, capsys):
    V, F = sshade.read("body.ply")
    chosen, names = np.array([0, 5, 20, 30]), NAMES
    target = V[chosen] + [[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0.05, 0]]
    Path("rest.mrk.json").write_text(markups(V[chosen].tolist(), names))
    Path("target.fcsv").write_text(fiducials((target * MIRROR)[::-1], names[::-1], "RAS"))
    line = ["deform", "body.ply", "rest.mrk.json", "target.fcsv", "-o", "out.ply", "--vertices", "60"]
    assert main(line) == 0 and "4 handles on target" in capsys.readouterr().err
    np.testing.assert_allclose(sshade.read("out.ply").V[chosen], target, rtol=0, atol=1e-12)
    assert main(["show", "body.ply", "rest.mrk.json", "target.fcsv", "out.ply", "-o", "page.html"]) == 0
    handles = sshade.read_handles("rest.mrk.json", sshade.Mesh(V, F), target="target.fcsv")
    assert np.array_equal(handles.index, chosen) and handles.group.tolist() == [0, 1, 2, 3]
    assert handles.dynamic.tolist() == [True, False, False, True]
    with pytest.raises(InputError, match="two landmark files"):
        sshade.read_handles("pose.json", sshade.Mesh(V, F), target="pose.json")


#: Content of the target beside a sound file a.csv of the rest shape, and words of the refusal.
BAD = {
    "short.csv": (
        lines(POINTS[:3], NAMES[:3], ","),
        "a.csv has 4 landmarks, and short.csv has 3; each needs",
    ),
    "other.csv": (
        lines(POINTS, ["a", "b", "c", "d"], ","),
        "other.csv: there is no landmark 'nasion', which a.csv has",
    ),
    "twice.csv": (lines(POINTS, ["a", "a", "c", "d"], ","), "twice.csv: two landmarks have the name 'a'"),
    "nan.csv": (
        lines([[np.nan, 0, 0]], ["chin"], ","),
        "nan.csv: landmark 0 'chin' has a NaN or infinite position",
    ),
    "word.txt": ("1 2 z\n", "word.txt: landmark 0 has no position of three numbers"),
    "weights.txt": ("0.5 2 3 1\n", "weights.txt: landmark 0 has 4 numbers; expected x y z, or name, x, y, z"),
    "few.csv": ("name,x,y,z\nnasion,1,2\n", "few.csv: landmark 0 has 3 values"),
    "none.csv": ("# nothing\n", "none.csv: it has no landmarks"),
    "broken.pp": ("<PickedPoints>", "broken.pp: not a readable landmark file (no element found"),
    "roi.mrk.json": (
        '{"markups": [{"type": "ROI"}]}',
        "roi.mrk.json: not a readable landmark file (it has no 'controlPoints')",
    ),
    "unset.mrk.json": (
        markups(POINTS, NAMES, positionStatus="undefined"),
        "unset.mrk.json: landmark 0 'nasion' has no position",
    ),
    "ijk.fcsv": (
        fiducials(POINTS, NAMES, "2"),
        "ijk.fcsv: the coordinate system '2' is unknown; use LPS or RAS",
    ),
    "pose.json": (
        '{"handles": [{"vertices": [0]}]}',
        "a.csv: a pose is one handle file, or two landmark files",
    ),
    "gone.csv": (None, "gone.csv: no such file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_landmarks_are_refused_in_one_sentence(sound, name, capsys):
    content, words = BAD[name]
    Path("a.csv").write_text(FILES["a.csv"][0])
    if content is not None:
        Path(name).write_text(content)
    assert main(["deform", "body.ply", "a.csv", name, "-o", "out.ply"]) == 2
    err = capsys.readouterr().err
    assert words in err and err.count("\n") == 1, err
    assert not Path("out.ply").exists()


@pytest.mark.parametrize("files", [["a.csv"], ["a.csv", "a.csv", "a.csv"], ["pose.json", "a.csv"]])
@pytest.mark.parametrize("output", ["out.ply", "out_%02d.ply"])
def test_landmark_files_come_in_pairs(sound, files, output, capsys):
    Path("a.csv").write_text(FILES["a.csv"][0])
    assert main(["deform", "body.ply", *files, "-o", output]) == 2
    assert "two landmark files (.csv, .txt, .mrk.json, .fcsv, .pp, .particles)" in capsys.readouterr().err
    assert not list(Path().glob("out*"))
