"""Rows as tables and files: types, the newest of equal runs, experiments by name, and halves."""

import csv

import pytest
from eval_rows import frame, row

from eval.main import call
from eval.rows import splits
from eval.rows.collect import read_experiments
from eval.rows.frame import newest, read_csv, records, write_csv
from eval.rows.splits import HELD_OUT, TUNING, split_of
from eval.rows.store import write_run
from sshade import InputError


@pytest.mark.parametrize("cut", [lambda text: text[: text[:-1].rindex("\n")], lambda text: text[:-2]])
def test_a_file_that_lost_its_end_is_noticed_wherever_it_was_cut(cut, tmp_path):
    path = tmp_path / "r.csv"
    write_csv(path, frame(*(row("ab"[i // 6], f"t{i}") for i in range(12))))
    assert len(read_csv(path)) == 12
    path.write_text(cut(path.read_text()))
    told = r"r.csv: line \d+ is of a file of 12? rows, but this file has 1[12]: it was cut"
    with pytest.raises(InputError, match=told):
        read_csv(path)


def test_a_cell_may_be_long_and_a_file_that_is_no_text_is_refused(tmp_path):
    csv.field_size_limit(131_072)
    write_csv(tmp_path / "r.csv", frame(row(reason=200_000 * "n" + "\r")))
    assert read_csv(tmp_path / "r.csv")["reason"][0] == 200_000 * "n" + "\n"
    (tmp_path / "r.csv").write_bytes(b"\xff")
    with pytest.raises(InputError, match="not a readable CSV file"):
        read_csv(tmp_path / "r.csv")


def test_a_rebuilt_dataset_replaces_the_old_and_copies_of_one_are_one():
    old = row(task__source="data/t")
    rebuilt = old | {"task.checksum": "d", "date": "2026-01-02"}
    another = row(task__checksum="e", task__source="data/low")
    assert records(newest(frame(rebuilt, another, old))) == [another, rebuilt]
    theirs = row(task__source="/elsewhere/t", date="2026-01-02")
    assert records(newest(frame(theirs, old))) == [theirs]
    plain = row(task__source='{"root": "data/t"}')
    dotted = row(task__checksum="e", task__source='{"root": "./data/t"}', date="2026-01-02")
    assert records(newest(frame(plain, dotted))) == [dotted | {"task.source": plain["task.source"]}]


def test_a_newer_version_replaces_an_older_one_whatever_its_date():
    new, late = row(method__version=2), row(date="2026-01-02")
    assert records(newest(frame(new, late))) == [new]
    assert records(newest(frame(row(measures=2), late))) == [row(measures=2)]


def test_folders_of_one_name_are_one_experiment_without_damaged_rows(here, capfd):
    for run in ("out/runs/mine/t1", "out/runs/mine/t2", "theirs/mine/t3"):
        write_run(here / run, row(task=run[-2:]))
    path = here / "out/runs/mine/t2/row.json"
    path.write_text(path.read_text()[:100])
    assert call("collect", ["mine", "theirs/mine"]) == 0
    assert "t2/row.json: not a row" in capfd.readouterr().err
    assert list(read_csv("out/rows/mine.csv")["task.name"]) == ["t1", "t3"]


def test_rows_are_published_or_ones_own(here):
    for folder, count in (("results", 1), ("out", 2)):
        write_csv(f"{folder}/rows/tiny.csv", frame(*(row(name) for name in "ab"[:count])))
        (found,) = read_experiments(["tiny"])
        assert len(found.rows) == count


def test_a_case_in_both_halves_is_refused(monkeypatch):
    monkeypatch.setattr(splits, "read_splits", lambda: {TUNING: ["a/*"], HELD_OUT: ["*/b"]})
    with pytest.raises(InputError, match="both halves"):
        split_of("a/b")
