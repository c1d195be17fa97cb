"""The comparison picture: which runs it shows, and that no method is run for it."""

from __future__ import annotations

import pytest

from eval.main import call
from eval.publish.figures import read_cases
from sshade.errors import InputError


def shown(cases):
    return [(case.task.name, list(case.results)) for case in cases]


def test_cases_come_from_the_run_folders(tiny_runs):
    every = ["arap", "learned", "stretching"]
    assert shown(read_cases(tiny_runs, names=[], methods=[])) == [("bumpy_10", every), ("bumpy_40", every)]
    only = read_cases(tiny_runs, names=["bumpy_40"], methods=["stretching"])
    assert shown(only) == [("bumpy_40", ["stretching"])]
    assert only[0].results["stretching"] == pytest.approx(1.5 * only[0].task.mesh.V, rel=1e-6)


def test_the_case_where_a_metric_is_largest(tiny_runs):
    (case,) = read_cases(tiny_runs, names=[], methods=["stretching"], worst="handle")
    assert case.task.name == "bumpy_40"
    named = read_cases(tiny_runs, names=["bumpy_10"], methods=[], worst="handle")
    assert [case.task.name for case in named] == ["bumpy_10"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["bumpy_99"]}, "no case 'bumpy_99'; there are bumpy_10, bumpy_40"),
        ({"methods": ["failing"]}, "no result of 'failing'"),
        ({"worst": "beauty"}, "no case has the metric 'beauty'"),
    ],
)
def test_what_was_not_run_is_a_clear_error(tiny_runs, options, message):
    with pytest.raises(InputError, match=message):
        read_cases(tiny_runs, **{"names": [], "methods": [], **options})


def test_command_runs_no_method(tiny_runs, tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("eval_cases.stretching", lambda *a, **k: pytest.fail("a figure ran a method"))
    out = tmp_path / "figures" / "tiny.png"
    camera = ["--towards", "1", "0", "0.2", "--up", "0", "0", "1"]
    assert call("figures", [str(tiny_runs), "-o", str(out), *camera]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
