"""Records of a dataset: schemas, and refusal of damaged records."""

import json

import pytest

from defaust.build.dataset import build
from defaust.build.verify import verify
from defaust.folder.record import FILES, read_dataset, read_record
from defaust.schema import mismatch
from defaust.tasks import load_task
from sshade import InputError
from tests.defaust.toy import OPTIONS, Balls, change, change_handles


@pytest.mark.parametrize(
    ("value", "schema", "words"),
    [
        ({"a": 1, "more": []}, {"a": int, "b?": str}, ""),
        ({"x": [1], "y": [], "z?": []}, {str: [int]}, ""),
        ({"a": True}, {"a": int}, "a is True, not a whole number"),
        ({"a": float("nan")}, {"a": float}, "a is nan, not a number"),
        ([10**400], [float], "[0] is 1" + 17 * "0" + "..." + 19 * "0" + ", not a number"),
        ({"a": {}}, {"a": {"b": int}}, "it has no a.b"),
        ({"a": [{"b": 1}, {"b": "x"}]}, {"a": [{"b": int}]}, "a[1].b is 'x', not a whole number"),
        ({"a": "x"}, {"a": (float, None)}, "a is 'x', not a number"),
    ],
)
def test_schemas(value, schema, words):
    assert mismatch(value, schema) == words


@pytest.mark.parametrize("name", ["../x", "a/../../x", "/etc/passwd", "", "C:/x", "C:\\x", "\\\\host\\x"])
def test_files_outside_of_the_folder_are_refused(tmp_path, name):
    path, entry = tmp_path / "a.json", {"sha256": "", "bytes": 0}
    path.write_text(json.dumps({"files": {"a.ply": entry, "a/b.ply": entry, "..a": entry}}))
    assert len(read_record(path, {"files": FILES})["files"]) == 3
    path.write_text(json.dumps({"files": {"a.ply": entry, name: entry}}))
    with pytest.raises(InputError, match="a.json: damaged, .* not inside the folder"):
        read_record(path, {"files": FILES})


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda d: d.update(format=9), "format 9"),
        (lambda d: d["build"].update(subjects=[0, 1]), '"subjects" and "build.subjects" differ'),
        (lambda d: d["poses"].pop("2"), "poses or class of subject 2 are missing"),
        (lambda d: d["source"].update(classes=["cat"]), "poses or class of subject 1 are missing"),
    ],
)
def test_a_record_that_contradicts_itself_is_refused(dataset, edit, words):
    change(dataset, edit)
    with pytest.raises(InputError, match=words):
        read_dataset(dataset, intact=False)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda c: c["handles"][0]["target"].pop(), 'entry 0 "top": 6 handles have 5 targets'),
        (lambda c: c["handles"][0].update(landmark="nose"), "landmarks differ from those of the dataset"),
    ],
)
def test_a_pose_file_that_is_listed_and_damaged_is_refused(dataset, edit, words):
    change_handles(dataset, "subject_00/pose_1.json", edit)
    with pytest.raises(InputError, match=words):
        load_task(dataset, subject=0, pose=1)


@pytest.mark.parametrize("record", ["{", "[]", "{}", '{"files": {"../../x": {}}}'])
def test_a_damaged_record_of_a_build_under_way_builds_the_subject_again(dataset, finished, record):
    (dataset / ".build").mkdir()
    (dataset / ".build/subject_01.json").write_text(record)
    build(Balls(), dataset, options=OPTIONS, workers=1)
    assert read_dataset(dataset) == read_dataset(finished) and verify(dataset) == []


def test_json_nested_too_deeply_is_no_json(dataset):
    (dataset / "dataset.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="nested too deeply"):
        read_dataset(dataset)
    (dataset / "dataset.json").unlink()
    (dataset / ".build").mkdir()
    (dataset / ".build/subject_00.json").write_text("{}")
    (dataset / ".build/recipe.json").write_text("[]")
    with pytest.raises(InputError, match="not a record of a build"):
        build(Balls(), dataset, options=OPTIONS, workers=1)
