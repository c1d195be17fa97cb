"""The comparison picture: which runs it shows, and that no method is run for it."""

from __future__ import annotations

import pytest
from eval_cases import bumpy_task

from eval.main import call
from eval.publish.figures import read_cases
from eval.run.run import run
from sshade.errors import InputError

SOURCE = {"_target_": "eval_cases.bumpy_task", "level": 2}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    for angle in (10.0, 40.0):
        task = bumpy_task(level=2, angle=angle)
        for name, factor in (("arap", 1.5), ("sshade", 1.25)):
            method = {"_target_": "eval_cases.stretching", "factor": factor}
            run(task, method, name=name, root=folder, source={**SOURCE, "angle": angle})
        run(task, {"_target_": "eval_cases.failing"}, name="failing", root=folder)
    return folder


def shown(cases):
    return [(case.task.name, list(case.results)) for case in cases]


def test_cases_come_from_the_run_folders(runs):
    both = ["arap", "sshade"]
    assert shown(read_cases(runs, names=[], methods=[])) == [("bumpy_10", both), ("bumpy_40", both)]
    only = read_cases(runs, names=["bumpy_40"], methods=["sshade"])
    assert shown(only) == [("bumpy_40", ["sshade"])]
    assert only[0].results["sshade"] == pytest.approx(1.25 * only[0].task.mesh.V, rel=1e-6)


def test_the_case_where_a_metric_is_largest(runs):
    (case,) = read_cases(runs, names=[], methods=["arap"], worst="handle")
    assert case.task.name == "bumpy_40"
    named = read_cases(runs, names=["bumpy_10"], methods=[], worst="handle")
    assert [case.task.name for case in named] == ["bumpy_10"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["bumpy_99"]}, "no case 'bumpy_99'; there are bumpy_10, bumpy_40"),
        ({"methods": ["failing"]}, "no result of 'failing'"),
        ({"worst": "beauty"}, "no case has the metric 'beauty'"),
    ],
)
def test_what_was_not_run_is_a_clear_error(runs, options, message):
    with pytest.raises(InputError, match=message):
        read_cases(runs, **{"names": [], "methods": [], **options})


def test_a_changed_dataset_is_a_clear_error(tmp_path):
    source = {**SOURCE, "level": 3}
    run(bumpy_task(level=2), {"_target_": "eval_cases.stretching"}, name="s", root=tmp_path, source=source)
    with pytest.raises(InputError, match="has changed since the run"):
        read_cases(tmp_path, names=[], methods=[])


def test_command_runs_no_method(runs, tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("eval_cases.stretching", lambda *a, **k: pytest.fail("a figure ran a method"))
    out = tmp_path / "figures" / "tiny.png"
    camera = ["--towards", "1", "0", "0.2", "--up", "0", "0", "1"]
    assert call("figures", [str(runs), "-o", str(out), *camera]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
