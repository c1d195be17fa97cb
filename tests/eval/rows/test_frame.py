"""Rows as a pandas table: types in CSV, reading back, the newest of equal runs, labels."""

from pathlib import Path

import pytest
from eval_rows import frame, row

from eval.publish.summary import make_table
from eval.publish.tables import to_markdown
from eval.rows.frame import newest, read_csv, records, write_csv
from eval.rows.store import read_row, write_row
from sshade import InputError

RESULTS = Path(__file__).parents[3] / "results"


@pytest.mark.parametrize("path", sorted(RESULTS.glob("rows/*.csv")) + sorted(RESULTS.glob("timing/*.csv")))
def test_committed_rows_are_written_again_as_they_are(path, tmp_path):
    write_csv(tmp_path / "again.csv", read_csv(path))
    assert (tmp_path / "again.csv").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("cut", [lambda text: text[: text[:-1].rindex("\n")], lambda text: text[:-2]])
def test_a_file_that_lost_its_end_is_noticed_wherever_it_was_cut(cut, tmp_path):
    path = tmp_path / "r.csv"
    write_csv(path, frame(*(row("ab"[i // 6], f"t{i}") for i in range(12))))
    assert len(read_csv(path)) == 12
    path.write_text(cut(path.read_text()))
    told = r"r.csv: line \d+ is of a file of 12? rows, but this file has 1[12]: it was cut"
    with pytest.raises(InputError, match=told):
        read_csv(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"status": "fine"}, "its status is 'fine'"),
        ({"date": ""}, "it has no date"),
        ({"metric.edge": "small"}, "its metric.edge is 'small'"),
    ],
)
def test_rows_that_no_run_wrote_are_refused(tmp_path, changes, words):
    write_csv(tmp_path / "r.csv", frame(row() | changes))
    with pytest.raises(InputError, match=words):
        read_csv(tmp_path / "r.csv")


@pytest.mark.parametrize("label", ["5.0", "1e3", "true", "nan", "007", "a|b"])
def test_a_label_that_looks_like_a_number_is_a_name(label, tmp_path):
    write_csv(tmp_path / "r.csv", frame(row(label), row("arap")))
    rows = read_csv(tmp_path / "r.csv")
    assert set(rows["method.name"]) == {label, "arap"}
    write_row(tmp_path, row(label))
    assert read_row(tmp_path)["method.name"] == label
    assert f"| {label.replace('|', chr(92) + '|')} | 1 |" in to_markdown(make_table(rows, title="t"))


def test_a_rebuilt_dataset_replaces_the_old_and_copies_of_one_are_one():
    old = row(task__source="data/t")
    rebuilt = old | {"task.checksum": "d", "date": "2026-01-02"}
    another = row(task__checksum="e", task__source="data/low")
    assert records(newest(frame(rebuilt, another, old))) == [another, rebuilt]
    theirs = row(task__source="/elsewhere/t", date="2026-01-02")
    assert records(newest(frame(theirs, old))) == [theirs]


def test_a_newer_version_replaces_an_older_one_whatever_its_date():
    new, late = row(method__version=2), row(date="2026-01-02")
    assert records(newest(frame(new, late))) == [new]
    assert records(newest(frame(row(measures=2), late))) == [row(measures=2)]
