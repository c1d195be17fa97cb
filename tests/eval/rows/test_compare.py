"""Rows of a sweep that ran twice: columns that must be equal, and columns that may differ."""

import pandas as pd
import pytest
from eval_rows import frame, row

from eval.main import call
from eval.rows.compare import differences
from eval.rows.frame import write_csv
from eval.rows.store import run_folder, write_run
from sshade.core.errors import InputError

ROWS = [row(seed=seed, key=f"k{seed}", **{"env.version.numpy": "2", "method.factor": 2.0}) for seed in (0, 1)]


def test_the_same_sweep_twice_is_equal_up_to_what_the_command_names(tmp_path, capsys):
    other = {"date": "2026-02-02", "env.machine": "laptop", "seconds.total": 9.0, "peak_mib": 4.0}
    write_csv(tmp_path / "a.csv", frame(*ROWS))
    for one in ROWS:
        write_run(run_folder(tmp_path / "b", one), one | other)
    assert call("compare", [str(tmp_path / "a.csv"), str(tmp_path / "b")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("2 and 2 rows, ") and "0 differences" in out
    assert "left out: date, env.*, peak_mib, seconds.*, task.source (but not env.version.*)" in out
    write_csv(tmp_path / "c.csv", frame(ROWS[0], ROWS[1] | {"method.factor": 3.0}))
    assert call("compare", [str(tmp_path / "c.csv"), str(tmp_path / "b")]) == 1
    assert "a t1 seed 1: method.factor is 3.0 and 2.0\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("column", "value"),
    [("metric.volume", 1.0000001), ("key", "0"), ("env.version.numpy", "0"), ("extra.new", 1)],
)
def test_a_changed_column_is_named(column, value):
    (text,) = differences(frame(*ROWS), frame(ROWS[0], ROWS[1] | {column: value}))
    assert text.startswith(f"a t1 seed 1: {column} is ") and text.endswith(repr(value))


def test_runs_of_one_set_alone_are_named():
    both, one = frame(*ROWS), frame(ROWS[0])
    assert differences(both, one) == ["a t1 seed 1: only in the first"]
    assert differences(one, both) == ["a t1 seed 1: only in the second"]
    with pytest.raises(InputError, match="several rows"):
        differences(pd.concat([both, one]), both)
