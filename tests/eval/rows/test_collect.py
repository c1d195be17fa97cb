"""Rows of several runs, folders, people and machines are one experiment, which is found by its name."""

from pathlib import Path

import pytest
from eval_rows import frame, lost, row

from eval.main import call
from eval.rows.collect import Experiment, read_experiments
from eval.rows.frame import read_csv, write_csv
from eval.rows.store import run_folder, write_run
from sshade import InputError


@pytest.fixture
def people(tmp_path):
    for who, rows in {
        "alice": [row(key="k1", task__source="t"), row(seed=1, key="k2", task__source="t")],
        "bob": [
            row(key="k1", date="2026-01-02", task__source="/t"),
            row(env__machine="laptop", key="k1", task__name="u"),
        ],
    }.items():
        for i, one in enumerate(rows):
            write_run(tmp_path / who / "quick" / str(i), one)
    write_run(tmp_path / "alice" / "other" / "0", row())
    return tmp_path


def test_folders_of_one_name_are_one_experiment(people):
    folders = [str(people / who) for who in ("alice/quick", "alice/other", "bob/quick")]
    assert call("collect", [*folders, "-o", str(people / "rows")]) == 0
    merged = read_csv(people / "rows/quick.csv")[["task.name", "seed", "env.machine", "date"]]
    first, second, third = merged.to_numpy().tolist()
    assert first == ["t1", 0, "box", "2026-01-02"] and second == ["t1", 1, "box", "2026-01-01"]
    assert third == ["u", 0, "laptop", "2026-01-01"]
    assert len(read_csv(people / "rows/other.csv")) == 1
    again = people / "again"
    assert call("collect", [*reversed(folders), "-o", str(again)]) == 0
    assert (again / "quick.csv").read_bytes() == (people / "rows/quick.csv").read_bytes()


def test_a_damaged_row_is_left_out_with_a_note(here, capfd):
    for task in ("t1", "t2"):
        write_run(here / "out/runs/mine" / task, row(task=task))
    path = here / "out/runs/mine/t2/row.json"
    path.write_text(path.read_text()[:100])
    assert call("collect", ["mine"]) == 0
    assert "t2/row.json: not a row" in capfd.readouterr().err
    assert list(read_csv("out/rows/mine.csv")["task.name"]) == ["t1"]


def test_cases_of_an_experiment():
    one = [row("arap"), row("arap", seed=1), row("paper"), lost("paper", "t2"), row("b", "t2")]
    low = row("arap", task__checksum="low", task__vertices=100)
    cases = Experiment("tiny", frame(*one, low), Path()).cases()
    told = [[(r["task.name"], r["task.vertices"], r["method.name"]) for r in case] for case in cases]
    assert told == [[("t1", 100, "arap")], [("t1", 1000, "arap"), ("t1", 1000, "paper")], [("t2", 1000, "b")]]


def test_experiments_are_found_by_name(here):
    with pytest.raises(InputError, match="holds no rows"):
        read_experiments([])
    write_csv("out/rows/tiny.csv", frame(row()))
    write_csv("elsewhere/tiny.csv", frame(row(), row("b")))
    for names in ([], ["tiny"], ["out/rows/tiny.csv"]):
        (found,) = read_experiments(names)
        assert found.name == "tiny" and len(found.rows) == 1 and str(found.runs) == "out/runs/tiny"
    with pytest.raises(InputError, match="two experiments are named 'tiny'"):
        read_experiments(["tiny", "elsewhere/tiny.csv"])


def test_rows_are_published_or_ones_own(here):
    for folder, count in (("results", 1), ("out", 2)):
        write_csv(f"{folder}/rows/tiny.csv", frame(*(row(name) for name in "ab"[:count])))
        (found,) = read_experiments(["tiny"])
        assert len(found.rows) == count
    write_run(run_folder("out/runs/new", row()), row())
    with pytest.raises(InputError, match="no runs in older or out/runs/older; out/runs has new$"):
        call("collect", ["older"])
