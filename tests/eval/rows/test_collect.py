"""Rows of several runs, folders, people and machines are joined into one file for each experiment."""

import pytest
from eval_rows import row

from eval.main import call
from eval.rows.frame import read_csv
from eval.rows.store import write_run


@pytest.fixture
def people(tmp_path):
    for who, rows in {
        "alice": [row(key="k1", task__source="t"), row(seed=1, key="k2", task__source="t")],
        "bob": [
            row(key="k1", date="2026-01-02", task__source="/elsewhere/t"),
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
