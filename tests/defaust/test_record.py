"""Records of a dataset: what is missing or of another kind is named by its place, before it is used."""

import json

import pytest

from defaust.build.dataset import build
from defaust.folder.layout import checksum, dump, read_dataset
from defaust.folder.record import POINT, Each, require, require_inside
from defaust.folder.verify import verify
from defaust.tasks import load_task
from sshade import InputError
from tests.defaust.test_verify import relist
from tests.defaust.toy import OPTIONS, Balls


@pytest.mark.parametrize(
    ("value", "shape"),
    [
        (1, int),
        (1, float),
        (1.5, (float, type(None))),
        (None, (float, type(None))),
        ([], [int]),
        ({"a": 1, "more": []}, {"a": int, "b?": str}),
        ({"a": 1, "b": "x"}, {"a": int, "b?": str}),
        ({"x": [1], "y": []}, Each([int])),
        ([0, 1.5, -2], POINT),
    ],
)
def test_what_fits(value, shape):
    require(value, shape, where="file")


@pytest.mark.parametrize(
    ("value", "shape", "words"),
    [
        (True, {"a": int}, "file: damaged, it is no object"),
        ({"a": True}, {"a": int}, "a is not a whole number"),
        ({"a": 1.0}, {"a": int}, "a is not a whole number"),
        ({"a": float("nan")}, {"a": float}, "a is not a number"),
        ({"a": "1"}, {"a": float}, "a is not a number"),
        ({"a": 1}, {"a": bool}, "a is not true or false"),
        ({"a": None}, {"a": str}, "a is not a text"),
        ({"a": {}}, {"a": {"b": int}}, "it has no a.b"),
        ({"a": [{"b": 1}, {"b": "x"}]}, {"a": [{"b": int}]}, r"a\[1\].b is not a whole number"),
        ({"a": {"x": 1}}, {"a": [int]}, "a is no list"),
        ({"a": {"x": 1}}, {"a": Each(str)}, "a.x is not a text"),
        ({"b": 1}, {"b?": str}, "b is not a text"),
        ({"a": "x"}, {"a": (float, type(None))}, "a is not a number"),
        ([[0, 1]], [POINT], r"\[0\] is not three numbers"),
        ([[0, 1, None]], [POINT], "is not three numbers"),
    ],
)
def test_what_does_not_fit_is_named(value, shape, words):
    with pytest.raises(InputError, match=words):
        require(value, shape, where="file")


@pytest.mark.parametrize("name", ["../x", "a/../../x", "/etc/passwd", "", "C:/x", "C:\\x", "\\\\host\\x"])
def test_files_outside_of_the_folder_are_refused(name):
    require_inside(["a.ply", "a/b.ply", "..a"], where="file")
    with pytest.raises(InputError, match="not inside the folder"):
        require_inside(["a.ply", name], where="file")


def change(root, edit, *, sign=True):
    """Edit dataset.json; with its own checksum made again unless not to be signed."""
    path = root / "dataset.json"
    document = json.loads(path.read_text())
    edit(document)
    if sign:
        document["checksum"] = checksum(document)
    path.write_text(dump(document))


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda d: d["subjects"][1]["high"].pop("vertices"), r"it has no subjects\[1\].high.vertices"),
        (lambda d: d["files"].update({"../out": d["files"]["README.md"]}), "'../out', which is not inside"),
        (lambda d: d["build"].update(target_vertices="many"), "build.target_vertices is not"),
        (lambda d: d["poses"].pop("2"), "does not say all of subject 2"),
        (lambda d: d["source"].update(classes=["cat"]), "does not say all of subject 1"),
    ],
)
def test_a_damaged_record_is_refused_by_whoever_reads_it(dataset, edit, words):
    change(dataset, edit)
    for read in (read_dataset, verify, lambda root: load_task(root, subject=0, pose=1)):
        with pytest.raises(InputError, match=words):
            read(dataset)


def test_a_record_changed_after_the_build_is_not_used(dataset):
    change(dataset, lambda d: d["source"].update(title="cubes"), sign=False)
    with pytest.raises(InputError, match="changed after the build"):
        load_task(dataset, subject=0, pose=1)
    assert {fault.file for fault in verify(dataset)} == {"dataset.json", "README.md"}


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda c: c.pop("source_pose"), "has no source_pose"),
        (lambda c: c["handles"][0].update(source="x"), r"handles\[0\].source is no list"),
        (lambda c: c["handles"][0]["target"].pop(), "top has other numbers of sources and targets"),
        (lambda c: c["handles"][0].update(landmark="nose"), "no landmark 'nose'"),
    ],
)
def test_a_pose_file_that_is_listed_and_damaged_is_refused(dataset, edit, words):
    path = dataset / "subject_00/pose_1.json"
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(dump(content))
    relist(dataset, "subject_00/pose_1.json")
    with pytest.raises(InputError, match=words):
        load_task(dataset, subject=0, pose=1)


@pytest.mark.parametrize("record", ["{", "[]", "{}", '{"files": {"../../x": {}}}'])
def test_a_damaged_record_of_a_build_under_way_builds_the_subject_again(dataset, finished, record):
    (dataset / ".build").mkdir()
    (dataset / ".build/subject_01.json").write_text(record)
    build(Balls(), dataset, options=OPTIONS, workers=1)
    assert read_dataset(dataset) == read_dataset(finished) and verify(dataset) == []


def test_a_recipe_that_is_none_is_refused(tmp_path):
    (tmp_path / "x/.build").mkdir(parents=True)
    (tmp_path / "x/.build/recipe.json").write_text("[]")
    (tmp_path / "x/.build/subject_00.json").write_text("{}")
    with pytest.raises(InputError, match="not a record of a build"):
        build(Balls(), tmp_path / "x", options=OPTIONS, workers=1)


def test_json_nested_too_deeply_is_no_json(dataset):
    (dataset / "dataset.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="nested too deeply"):
        read_dataset(dataset)
