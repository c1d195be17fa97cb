"""Experiments are found by name among one's own rows, published rows, and folders of runs."""

import pytest
from eval_rows import frame, row

from eval.rows.collect import Experiment, load_rows, read_experiments
from eval.rows.files import rows_file
from eval.rows.frame import write_csv
from eval.rows.store import run_folder, write_run
from sshade.core.errors import InputError


def test_cases_of_an_experiment():
    one = [
        row("arap"),
        row("arap", seed=1),
        row("paper"),
        row("paper", "t2", status="failed"),
        row("b", "t2"),
    ]
    low = row("arap", task__checksum="low", task__vertices=100)
    cases = Experiment("tiny", frame(*one, low), ()).cases()
    told = [[(r["task.name"], r["task.vertices"], r["method.name"]) for r in case] for case in cases]
    assert told == [[("t1", 100, "arap")], [("t1", 1000, "arap"), ("t1", 1000, "paper")], [("t2", 1000, "b")]]


def test_experiments_are_found_by_name(here):
    with pytest.raises(InputError, match="holds no rows"):
        read_experiments([])
    write_csv("out/rows/tiny.csv", frame(row()))
    write_csv("elsewhere/tiny.csv", frame(row(), row("b")))
    for names in ([], ["tiny"], ["out/rows/tiny.csv"]):
        (found,) = read_experiments(names)
        assert found.name == "tiny" and len(found.rows) == 1 and str(found.runs[0]) == "out/runs/tiny"
    with pytest.raises(InputError, match="two experiments are named 'tiny'"):
        read_experiments(["tiny", "elsewhere/tiny.csv"])


def test_published_rows_are_read_where_there_are_none_of_ones_own(here):
    write_csv("results/rows/tiny.csv", frame(row()))
    assert str(rows_file("tiny")) == "results/rows/tiny.csv" and len(load_rows("tiny")) == 1
    write_csv("out/rows/tiny.csv", frame(row(), row("b")))
    assert str(rows_file("tiny")) == "out/rows/tiny.csv" and len(load_rows("tiny")) == 2


def test_runs_that_were_not_collected_are_rows_too(here):
    write_run(run_folder("out/runs/new", row()), row())
    assert len(load_rows("new")) == len(load_rows("out/runs/new")) == 1
    with pytest.raises(InputError, match="no runs in older or out/runs/older; out/runs has new$"):
        load_rows("older")
