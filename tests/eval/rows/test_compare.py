"""Rows of one sweep run twice: what must be equal, and what may differ."""

from __future__ import annotations

import pandas as pd
import pytest
from eval_cases import bumpy_task

from eval.main import call
from eval.rows.collect import collect
from eval.rows.compare import differences
from eval.rows.frame import records, to_frame, write_csv
from eval.run.run import run
from sshade.errors import InputError

STRETCHING = {"_target_": "eval_cases.stretching", "factor": 2.0}


@pytest.fixture
def folders(tmp_path):
    task = bumpy_task(level=2)
    for name, jobs in (("a", 1), ("b", 3)):
        for seed in (0, 1):
            run(task, STRETCHING, name="s", root=tmp_path / name, seed=seed, jobs=jobs)
    return tmp_path / "a", tmp_path / "b"


def test_the_same_sweep_twice_is_equal_up_to_what_the_command_names(folders, tmp_path, capsys):
    first, second = map(collect, folders)
    assert not first.equals(second)
    assert differences(first, second) == []
    assert call("compare", [str(folder) for folder in folders]) == 0
    out = capsys.readouterr().out
    assert out.startswith("2 and 2 rows, ") and "0 differences" in out
    assert "left out: date, env.*, peak_mib, seconds.*, task.source (but not env.version.*)" in out
    write_csv(tmp_path / "a.csv", first)
    assert call("compare", [str(tmp_path / "a.csv"), str(folders[0])]) == 0


@pytest.mark.parametrize(
    ("column", "value"),
    [("metric.volume", 700.0000001), ("key", "0"), ("env.version.numpy", "0"), ("extra.new", 1)],
)
def test_a_changed_column_is_named(folders, column, value):
    first, second = map(collect, folders)
    rows = records(second)
    (text,) = differences(first, to_frame([rows[0], rows[1] | {column: value}]))
    assert text.startswith(f"s bumpy_30 seed 1: {column} is ") and text.endswith(repr(value))


def test_runs_of_one_set_alone_are_named(folders, capsys):
    first, second = map(collect, folders)
    assert differences(first, second[:1]) == ["s bumpy_30 seed 1: only in the first"]
    assert differences(first[:1], second) == ["s bumpy_30 seed 1: only in the second"]
    with pytest.raises(InputError, match="several rows"):
        differences(pd.concat([first, first[:1]]), second)
    changed = STRETCHING | {"factor": 3.0}
    run(bumpy_task(level=2), changed, name="s", root=folders[1].parent / "c")
    assert call("compare", [str(folders[0]), str(folders[1].parent / "c")]) == 1
    assert "s bumpy_30 seed 0: method.factor is 2.0 and 3.0\n" in capsys.readouterr().out
