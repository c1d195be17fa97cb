"""Rows of several runs, folders, people and machines together."""

from __future__ import annotations

import pytest

from eval.main import call
from eval.rows.store import newest, read_csv, write_run
from sshade.errors import InputError


def row(**changes):
    values = {
        "method.name": "a",
        "method.hash": "h",
        "task.name": "t",
        "task.checksum": "c",
        "task.source": "data/t",
        "seed": 0,
        "status": "ok",
        "env.machine": "box",
        "date": "2026-01-01",
        "key": "k",
    }
    return {**values, **{name.replace("__", "."): value for name, value in changes.items()}}


def test_the_newest_of_equal_runs_is_kept():
    old, new = row(date="2026-01-01"), row(date="2026-01-02")
    other_seed = row(seed=1, date="2025-01-01")
    other_method = row(method__hash="i")
    assert newest([new, other_seed, old, other_method]) == [new, other_seed, other_method]


def test_a_rebuilt_dataset_replaces_the_old_and_another_does_not():
    old, rebuilt = row(), row(task__checksum="d", date="2026-01-02")
    another = row(task__checksum="e", task__source="data/low")
    assert newest([rebuilt, another, old]) == [another, rebuilt]


def test_copies_of_a_dataset_are_one():
    mine, theirs = row(), row(task__source="/home/bob/t", date="2026-01-02")
    assert newest([theirs, mine]) == [theirs]


def test_machines_are_kept_apart_unless_asked():
    mine, theirs = row(), row(env__machine="laptop", date="2026-01-02")
    assert newest([theirs, mine]) == [mine, theirs]
    assert newest([theirs, mine], across_machines=True) == [theirs]


@pytest.fixture
def people(tmp_path):
    for who, rows in {
        "alice": [row(key="k1"), row(seed=1, key="k2")],
        "bob": [
            row(key="k1", date="2026-01-02", task__source="/home/bob/t"),
            row(env__machine="laptop", key="k1", task__name="u"),
        ],
    }.items():
        for i, one in enumerate(rows):
            write_run(tmp_path / who / "quick" / str(i), one)
    write_run(tmp_path / "alice" / "other" / "0", row())
    return tmp_path


def test_folders_of_one_name_are_one_experiment(people, capsys):
    folders = [str(people / who) for who in ("alice/quick", "alice/other", "bob/quick")]
    assert call("collect", [*folders, "-o", str(people / "rows")]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told == [f"{people}/rows/quick.csv: 3 rows of 2 machines", f"{people}/rows/other.csv: 1 row"]
    merged = [
        (r["task.name"], r["seed"], r["env.machine"], r["date"]) for r in read_csv(people / "rows/quick.csv")
    ]
    assert merged == [
        ("t", 0, "box", "2026-01-02"),
        ("t", 1, "box", "2026-01-01"),
        ("u", 0, "laptop", "2026-01-01"),
    ]
    again = people / "again"
    assert call("collect", [*reversed(folders), "-o", str(again)]) == 0
    assert (again / "quick.csv").read_bytes() == (people / "rows/quick.csv").read_bytes()


def test_a_relative_folder_gives_its_own_name(people, monkeypatch, capsys):
    monkeypatch.chdir(people / "alice" / "quick")
    assert call("collect", [".", "-o", str(people / "rows")]) == 0
    assert (people / "rows" / "quick.csv").is_file()


def test_a_folder_without_runs_is_an_error(tmp_path):
    with pytest.raises(InputError, match="no runs in"):
        call("collect", [str(tmp_path)])


def test_an_empty_folder_of_a_refused_run_is_no_experiment(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out" / "runs" / "refused").mkdir(parents=True)
    with pytest.raises(InputError, match="holds no experiment"):
        call("collect", [])
    write_run(tmp_path / "out" / "runs" / "mine" / "r", row())
    assert call("collect", []) == 0
    assert capsys.readouterr().out == "out/rows/mine.csv: 1 row\n"
