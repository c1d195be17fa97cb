"""Metrics measured again from stored vertices."""

from __future__ import annotations

import shutil

import pytest

from eval.main import call
from eval.metrics import METRICS, Metric
from eval.rows.store import read_row, run_folders, write_row
from eval.run import remeasure as module
from eval.run.remeasure import remeasure
from sshade.errors import InputError


@pytest.fixture
def runs(tiny_runs, tmp_path):
    """Two methods on two tasks, one of which fails."""
    for method in ("stretching", "failing"):
        shutil.copytree(tiny_runs / method, tmp_path / "tiny" / method)
    return tmp_path / "tiny"


def rows_of(root):
    return [read_row(folder) for folder in run_folders(root)]


def test_a_row_gets_the_metrics_that_it_lacks_and_keeps_the_rest(runs, monkeypatch):
    before = rows_of(runs)
    assert remeasure(runs) == 0 and rows_of(runs) == before
    folder = next(path for path in run_folders(runs) if read_row(path)["status"] != "failed")
    row = read_row(folder)
    lacking = {name: value for name, value in row.items() if name != "metric.area"}
    write_row(folder, lacking)
    monkeypatch.setitem(
        METRICS, "count", Metric("count", "count", "n", lambda deformed: len(deformed.shape.V))
    )
    assert remeasure(runs) == 2
    again = read_row(folder)
    assert again.pop("metric.area") == pytest.approx(row["metric.area"], rel=1e-6)
    assert again.pop("metric.count") == 162 and again.pop("remeasured") == "area count"
    lacking.pop("metric.area", None)
    assert again == lacking
    others = [new for new, old in zip(rows_of(runs), before, strict=True) if old["status"] == "failed"]
    assert others == [old for old in before if old["status"] == "failed"]
    assert (folder / "vertices.npy").is_file() and not list(folder.glob(".*"))
    assert remeasure(runs) == 0


def test_named_metrics_are_computed_in_any_case(runs, monkeypatch, capsys):
    monkeypatch.setitem(METRICS, "area", Metric("area", "%", "7", lambda deformed: 7.0))
    assert call("remeasure", [str(runs), "--metrics", "area"]) == 0
    assert f"{runs}: 2 of 4 rows changed" in capsys.readouterr().out
    valid = [row for row in rows_of(runs) if row["status"] != "failed"]
    assert [(row["metric.area"], row["remeasured"]) for row in valid] == [(7.0, "area")] * 2


def test_a_metric_that_the_task_has_nothing_for_changes_no_row(runs):
    assert remeasure(runs, metrics=["hausdorff"]) == 0


def test_a_task_is_loaded_once_for_all_its_methods(runs, tiny_runs, monkeypatch):
    shutil.copytree(tiny_runs / "learned", runs / "learned")
    loads = []
    load = module.load_task
    monkeypatch.setattr(module, "load_task", lambda row: loads.append(row["task.name"]) or load(row))
    assert remeasure(runs, metrics=["area"]) == 4
    assert sorted(loads) == ["bumpy_10", "bumpy_40"]


def test_mistakes_are_told(runs):
    with pytest.raises(InputError, match="no metric 'aera'; there are volume"):
        remeasure(runs, metrics=["aera"])
    folder = next(path for path in run_folders(runs) if read_row(path)["status"] != "failed")
    write_row(folder, read_row(folder) | {"task.checksum": "other"})
    with pytest.raises(InputError, match="has changed since the run"):
        remeasure(runs, metrics=["area"])
