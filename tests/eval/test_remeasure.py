"""Metrics measured again from stored vertices."""

import re
import shutil

import pytest

from eval.main import call
from eval.metrics import METRICS, Metric
from eval.rows.store import read_row, run_folders, write_row
from eval.run.code import METRICS as METRICS_VERSION
from eval.run.remeasure import remeasure
from sshade.core.errors import InputError


@pytest.fixture
def runs(tiny_runs, tmp_path):
    """Copy the runs of two methods on two tasks; the runs of one method failed."""
    for method in ("stretching", "failing"):
        shutil.copytree(tiny_runs / method, tmp_path / "tiny" / method)
    return tmp_path / "tiny"


def rows_of(root):
    return [read_row(folder) for folder in run_folders(root)]


def outdate(root, *, of=None):
    """Give the valid rows, of all tasks or of one task, an older metrics version; return their folders."""
    folders = [f for f in run_folders(root) if read_row(f)["status"] != "failed"]
    folders = [folder for folder in folders if of in (None, read_row(folder)["task.name"])]
    for folder in folders:
        write_row(folder, read_row(folder) | {"env.version.metrics": "older", "metric.gone": 1.0})
    return folders


def test_rows_of_other_metrics_are_measured_again_whole_and_no_others(runs, monkeypatch, capsys):
    before = rows_of(runs)
    assert remeasure(runs) == 0 and rows_of(runs) == before
    (folder,) = outdate(runs, of="bumpy_10")
    row = read_row(folder)
    monkeypatch.setitem(METRICS, "area", Metric("area", "%", "7", lambda deformed: 7.0))
    count = Metric("count", "count", "n", lambda deformed: len(deformed.shape.V))
    monkeypatch.setitem(METRICS, "count", count)
    assert call("remeasure", [str(runs)]) == 0
    assert f"{runs}: 1 of 4 rows changed" in capsys.readouterr().out
    again = read_row(folder)
    assert again.pop("remeasured").startswith("20") and row.pop("metric.gone")
    assert again.pop("metric.count") == 162 and again.pop("metric.area") == 7.0 != row.pop("metric.area")
    assert again.pop("env.version.metrics") == METRICS_VERSION and row.pop("env.version.metrics")
    metrics = [name for name in row if name.startswith("metric.") and row[name] is not None]
    found, expected = ({name: one.pop(name) for name in metrics} for one in (again, row))
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-4)
    assert again == row
    assert (folder / "vertices.npy").is_file() and not list(folder.glob(".*"))
    others = [r for r in rows_of(runs) if r["key"] != row["key"]]
    assert others == [r for r in before if r["key"] != row["key"]]
    assert remeasure(runs) == 0


def test_mistakes_are_told_and_change_no_row(runs):
    folder, other = outdate(runs)
    before = read_row(folder)
    write_row(folder, before | {"task.checksum": "other"})
    with pytest.raises(InputError, match=f"^{re.escape(str(folder))}: .* has changed since the run; run it"):
        remeasure(runs)
    write_row(folder, before)
    (folder / "vertices.npy").unlink()
    (other / "vertices.npy").unlink()
    with pytest.raises(InputError, match="vertices.npy: no such file; the run left no vertices"):
        remeasure(runs)
    assert read_row(folder) == before
