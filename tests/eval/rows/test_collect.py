"""Rows of several runs, folders, people and machines are joined into one file for each experiment."""

import pytest
from eval_rows import row

from eval.main import call
from eval.rows.frame import read_csv, records, to_frame, write_csv
from eval.rows.plan import write_plan
from eval.rows.store import write_run
from sshade.core.errors import InputError


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


def test_an_empty_folder_of_a_refused_run_is_no_experiment(here):
    (here / "out/runs/refused").mkdir(parents=True)
    with pytest.raises(InputError, match="holds no experiment"):
        call("collect", [])
    write_run(here / "out/runs/mine/r", row())
    assert call("collect", []) == 0
    assert len(read_csv("out/rows/mine.csv")) == 1


VERSION = {"env.version.code": "c", "env.version.metrics": "m"}


def planned(method, task):
    return {"method.name": method, "seed": 0, "task.source": f'{{"pose": "{task}"}}'}


def versioned(method, task, **changes):
    return row(method, task, key=f"{method} {task}") | planned(method, task) | VERSION | changes


def test_published_rows_of_the_same_version_and_what_is_missing_are_taken_in(here, capsys):
    lacking = planned("d", "t1") | {"task.name": "t1", "status": "missing", "reason": "planned, never run"}
    published = [versioned("a", "t1", date="2025-01-01"), versioned("b", "t1"), versioned("c", "t1"), lacking]
    write_csv("results/rows/tiny.csv", to_frame(published))
    runs = [planned(method, task) | VERSION for method in "abc" for task in ("t1", "t2")]
    write_plan(here / "out/runs/tiny", runs)
    assert call("collect", []) == 0  # published rows alone are enough
    assert "tiny.csv: 3 rows, 4 of 7 planned runs missing\n" in capsys.readouterr().out
    write_run(here / "out/runs/tiny/0", versioned("a", "t1"))
    write_run(here / "out/runs/tiny/1", versioned("a", "t2"))
    assert call("collect", ["tiny"]) == 0
    rows = {(r["method.name"], r["task.name"]): r for r in records(read_csv("out/rows/tiny.csv"))}
    assert {run: row["status"] for run, row in rows.items()} == {
        **{(method, "t1"): "ok" for method in "abc"},
        ("a", "t2"): "ok",
        **{(method, "t2"): "missing" for method in "bc"},
        ("d", "t1"): "missing",
    }
    assert rows["a", "t1"]["date"] == "2026-01-01"


@pytest.mark.parametrize("name", VERSION)
def test_published_rows_of_another_version_are_not(here, name):
    write_csv("results/rows/tiny.csv", to_frame([versioned("b", "t1", **{name: "older"})]))
    write_run(here / "out/runs/tiny/0", versioned("a", "t1"))
    assert call("collect", ["tiny"]) == 0
    assert list(read_csv("out/rows/tiny.csv")["method.name"]) == ["a"]
    (here / "out/runs/tiny/0/row.json").unlink()
    write_plan(here / "out/runs/tiny", [planned("b", "t1") | VERSION])
    with pytest.raises(InputError, match="no runs there"):
        call("collect", ["tiny"])
