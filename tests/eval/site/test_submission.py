"""Submitted results: accepted files, and every reason for a refusal."""

import json
import shutil

import pytest
import yaml

from eval.main import main
from eval.rows.frame import to_frame, write_csv
from eval.rows.store import read_row, run_folders, write_row
from eval.site import submission as module
from eval.site.submission import check, read_facts
from eval.site.tracks import Track
from sshade.errors import InputError

TRACK = Track("tiny", "Tiny", "Two bumpy spheres.", None)
CLEAN = {"env.modified": False, "env.commit": "a" * 40}
FACTS = {"name": "stretching", "track": "tiny", "authors": "A. N. Other", "code": "https://example.org/code"}


@pytest.fixture
def published(tiny_runs):
    return [read_row(folder) for folder in run_folders(tiny_runs / "arap")]


@pytest.fixture
def folder(tiny_runs, tmp_path, monkeypatch):
    """Make a correct submission; return its folder."""
    monkeypatch.setattr(module, "split_of", lambda task: "held_out")
    folder = tmp_path / "handed_in"
    shutil.copytree(tiny_runs / "stretching", folder / "runs" / "stretching")
    for run in run_folders(folder / "runs"):
        write_row(run, read_row(run) | CLEAN)
    (folder / "submission.yaml").write_text(yaml.safe_dump(FACTS))
    (folder / "method.yaml").write_text("_target_: eval_cases.stretching\n_partial_: true\nfactor: 1.5\n")
    put_rows(folder)
    return folder


def put_rows(folder, change=lambda row: row):
    """Write rows.csv from the runs. `change` returns the row to write, or None to leave the row out."""
    rows = [change(read_row(run)) for run in run_folders(folder / "runs")]
    write_csv(folder / "rows.csv", to_frame([row for row in rows if row]))


def test_what_is_right_is_taken_and_measured_again(folder, published):
    found = check(folder, TRACK, published)
    assert (len(found.rows), found.remeasured, found.facts) == (2, 2, FACTS)
    shutil.rmtree(folder / "runs")
    assert check(folder, TRACK, published).remeasured == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": None}, "has no 'name'"),
        ({"name": "../up"}, "small letters"),
        ({"code": "javascript:alert(1)"}, "begins with https://"),
        ({"code": 'https://x"onclick='}, "begins with https://"),
        ({"paper": "http://x"}, "begins with https://"),
        ({"authors": ["a"]}, "must be text"),
        ({"note": "x" * 501}, "at most 500 letters"),
        ({"prize": "first"}, "'prize' is unknown"),
        ("a: [", "not YAML"),
        ("- a", "not a mapping"),
        ("!!python/object:os.system {}", "not YAML"),
    ],
)
def test_facts_that_are_none_are_refused(folder, changes, message):
    if isinstance(changes, dict):
        facts = {name: value for name, value in {**FACTS, **changes}.items() if value is not None}
        changes = yaml.safe_dump(facts)
    (folder / "submission.yaml").write_text(changes)
    with pytest.raises(InputError, match=message):
        read_facts(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method.name": "other"}, "has rows of other"),
        ({"method.target": "eval_cases.other"}, "has rows of eval_cases.other"),
        ({"env.version.metrics": "older"}, "another version of the metrics"),
        ({"env.modified": True}, "not committed"),
        ({"env.commit": None}, "no commit"),
        (
            {"env.commit": None, "env.modified": None, "env.version.evaluator": "older"},
            "no commit and another",
        ),
        ({"env.machine_id": None}, "names no machine"),
        ({"task.checksum": "0123"}, "another task of this name"),
        ({"task.vertices": 7}, "another task of this name"),
        ({"task.name": "elsewhere"}, "not a case of the track"),
        ({"metric.edge": None}, "metric.edge of None"),
        ({"metric.edge": -1.0}, "metric.edge of -1.0"),
        ({"status": "failed", "reason": None}, "gives no reason"),
        ({"seconds.total": None}, "how long it took"),
    ],
)
def test_rows_that_are_not_the_tracks_are_refused(folder, published, changes, message):
    put_rows(folder, lambda row: row | changes)
    with pytest.raises(InputError, match=message):
        check(folder, TRACK, published)


def test_a_task_of_equal_files_is_the_same_whatever_the_processor_rounds(folder, published):
    facts = {"task.meta.checksum": "aa+bb", "task.meta.raw": False}
    official = [row | facts for row in published]
    put_rows(folder, lambda row: row | facts | {"task.checksum": "0123"})
    with pytest.raises(InputError, match="has changed since the run"):  # neither checksum is right
        check(folder, TRACK, [row | {"task.checksum": "4567"} for row in official])
    assert check(folder, TRACK, official).remeasured == 2
    shutil.rmtree(folder / "runs" / "stretching")
    (folder / "runs").rmdir()
    found = check(folder, TRACK, official)
    assert [row["task.checksum"] for row in found.rows] == [row["task.checksum"] for row in official]
    for other in {"task.meta.checksum": "aa+cc"}, {"task.meta.raw": True}, {"task.meta.checksum": None}:
        with pytest.raises(InputError, match="another task of this name"):
            check(folder, TRACK, [row | other for row in official])


def test_rows_of_a_wheel_have_no_commit_but_a_known_version(folder, published):
    put_rows(folder, lambda row: row | {"env.commit": None, "env.modified": None})
    assert len(check(folder, TRACK, published).rows) > 0


def test_an_infinite_distortion_is_taken(folder, published):
    infinite = {"metric.distortion": None, "metric.distortion_max": None}
    put_rows(folder, lambda row: row | infinite | {"metric.collapsed": 0.0})
    with pytest.raises(InputError, match="has a metric.distortion of None"):
        check(folder, TRACK, published)
    put_rows(folder, lambda row: row | infinite | {"metric.collapsed": 1.0})
    shutil.rmtree(folder / "runs")
    assert check(folder, TRACK, published).remeasured == 0


def test_settings_that_are_not_those_of_the_rows_are_refused(folder, published):
    path = folder / "method.yaml"
    path.write_text(path.read_text() + "vertices: ${proxy.vertices}\n")
    check(folder, TRACK, published)
    path.write_text(path.read_text().replace("factor: 1.5", "factor: 2"))
    with pytest.raises(InputError, match=r"method.yaml: says factor: 2, and rows.csv has 1.5"):
        check(folder, TRACK, published)


@pytest.mark.parametrize("column", ["method.hash", "env.version.code", "env.version.metrics"])
def test_rows_of_several_versions_are_refused(folder, published, column):
    put_rows(folder, lambda row: row | {column: row["task.name"]})
    with pytest.raises(InputError, match="several"):
        check(folder, TRACK, published)


def test_a_case_that_is_missing_or_there_twice_is_refused(folder, published):
    put_rows(folder, lambda row: row if row["task.name"] == "bumpy_10" else None)
    with pytest.raises(InputError, match="lacks 1 of the track's 2 held-out cases, such as bumpy_40"):
        check(folder, TRACK, published)
    rows = [read_row(run) for run in run_folders(folder / "runs")]
    write_csv(folder / "rows.csv", to_frame([*rows, rows[0]]))
    with pytest.raises(InputError, match="has 2 rows of bumpy_10, seed 0"):
        check(folder, TRACK, published)


def test_a_failed_run_counts_with_its_reason(folder, published):
    lost = {"status": "failed", "reason": "ValueError: no"}
    put_rows(folder, lambda row: row | (lost if row["task.name"] == "bumpy_40" else {}))
    assert check(folder, TRACK, published).remeasured == 1


def test_a_measure_that_is_not_that_of_the_vertices_is_refused(folder, published):
    put_rows(folder, lambda row: row | {"metric.edge": 0.9 * row["metric.edge"]})
    with pytest.raises(InputError, match="the vertices have edge"):
        check(folder, TRACK, published)


@pytest.mark.parametrize(
    ("name", "value", "reported", "same"),
    [
        ("distortion_max", 16731.5, 16786.9, True),
        ("distortion_max", 14000.0, 16786.9, False),
        ("distortion_95", 0.5, 0.501, False),
        ("edge", 16731.5, 16786.9, False),
        ("flips", 10, 12, True),
        ("flips", 10, 13, False),
        ("edge", None, 0.0, False),
        ("volume", None, None, True),
        ("detail", 1.1954, 1.1926, True),
        ("detail", 1.26, 1.1926, False),
    ],
)
def test_measures_agree_as_far_as_single_precision_goes(name, value, reported, same):
    assert module._agree(name, value, {f"metric.{name}": reported}) == same


@pytest.mark.parametrize(("worst", "same"), [(2.67e6, True), (60.0, False)])
def test_a_mean_distortion_agrees_as_far_as_its_worst_face(worst, same):
    row = {"metric.distortion": 56.402, "metric.distortion_max": worst}
    assert module._agree("distortion", 55.429, row) == same


def test_the_name_of_a_method_of_the_project_is_refused(folder, published):
    with pytest.raises(InputError, match="choose another"):
        check(folder, TRACK, [*published, published[0] | {"method.name": "stretching"}])


def test_a_program_is_named_by_its_rows_and_never_run(folder, published, here):
    command = ["touch", str(here / "hacked")]
    program = {"_target_": "baselines.external.external", "command": command}
    source = {"_target_": "baselines.external.external", "task": None, "command": command}
    facts = {"method.target": program["_target_"], "method.command": str(command)}
    put_rows(folder, lambda row: row | facts | {"task.source": json.dumps(source)})
    (folder / "method.yaml").write_text(yaml.safe_dump(program))
    assert check(folder, TRACK, published).remeasured == 2
    assert not (here / "hacked").exists()
    (folder / "method.yaml").write_text(yaml.safe_dump(program | {"command": ["touch", "other"]}))
    words = r"has rows of \['touch', .*, and the submission is of \['touch', 'other"
    with pytest.raises(InputError, match=words):
        check(folder, TRACK, published)
    (folder / "method.yaml").write_text(yaml.safe_dump({"defaults": ["external"], "command": command}))
    with pytest.raises(InputError, match=r"method\.yaml: has no _target_"):
        check(folder, TRACK, published)


def test_the_command_checks_and_copies(folder, published, here, monkeypatch, capsys):
    monkeypatch.setattr(module, "read_tracks", lambda: {"tiny": TRACK})
    monkeypatch.setattr(module, "published", lambda track: to_frame(published))
    assert main(["submit", str(folder), "--check"]) == 0
    assert "stretching on tiny: 2 runs, 1 seed, 2 measured again" in capsys.readouterr().out
    assert not (here / "submissions").exists()
    assert main(["submit", str(folder)]) == 0
    assert {path.name for path in (here / "submissions/stretching").iterdir()} == set(module.FILES)
    (folder / "submission.yaml").write_text(yaml.safe_dump({**FACTS, "track": "nowhere"}))
    assert main(["submit", str(folder), "--check"]) == 2
    assert "'nowhere' is no track; the tracks are tiny" in capsys.readouterr().err
