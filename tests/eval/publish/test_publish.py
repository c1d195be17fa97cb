"""The one command that changes what is committed, and that what is committed belongs together."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from eval_rows import frame, row

from eval.main import call
from eval.publish.summary import make_table
from eval.publish.tables import FORMATS, to_markdown
from eval.rows.frame import distinct, read_csv, write_csv
from eval.timing import table as of_times
from sshade.errors import InputError

RESULTS = Path(__file__).parents[3] / "results"
ROWS = sorted((RESULTS / "rows").glob("*.csv"))
TIMES = sorted((RESULTS / "timing").glob("*.csv"))
TIME_FORMATS = {"csv": of_times.to_csv, "md": of_times.to_markdown}


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project with older results and new rows of two experiments."""
    monkeypatch.chdir(tmp_path)
    write_csv("results/rows/tiny.csv", frame(row("old")))
    for name in ("tiny", "other"):
        write_csv(f"out/rows/{name}.csv", frame(row("arap"), row("sshade")))
    Path("out/figures").mkdir()
    Path("out/figures/tiny.png").write_bytes(b"a picture")
    return tmp_path


def contents() -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path("results").rglob("*.*")}


def test_rows_tables_and_figures_go_where_they_are_committed(project):
    assert call("publish", ["tiny"]) == 0
    found = contents()
    assert sorted(found) == [
        "results/figures/tiny.png",
        "results/rows/tiny.csv",
        *(f"results/tables/tiny.{suffix}" for suffix in sorted(FORMATS)),
    ]
    assert found["results/rows/tiny.csv"] == Path("out/rows/tiny.csv").read_bytes()
    table = to_markdown(make_table(read_csv("out/rows/tiny.csv"), title="tiny"))
    assert found["results/tables/tiny.md"].decode() == table
    assert found["results/figures/tiny.png"] == b"a picture"


def test_all_is_checked_before_anything_changes(project):
    before = contents()
    write_csv("out/rows/other.csv", frame(row("a"), row("a", "t2", method__hash="other")))
    with pytest.raises(InputError, match="different parameters"):
        call("publish", ["tiny", "other"])
    with pytest.raises(InputError, match="out/rows/nothing.csv: no such file"):
        call("publish", ["tiny", "nothing"])
    assert contents() == before


def test_a_figure_may_stand_alone_but_not_be_older_than_its_rows(project):
    Path("out/figures/scaling.svg").write_text("<svg/>")
    assert call("publish", ["scaling"]) == 0 and contents()["results/figures/scaling.svg"] == b"<svg/>"
    os.utime("out/figures/tiny.png", (0, 0))
    with pytest.raises(InputError, match="tiny.png is older than out/rows/tiny.csv"):
        call("publish", ["tiny"])


def test_elsewhere_nothing_is_published(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_csv("out/rows/tiny.csv", frame(row()))
    with pytest.raises(InputError, match="no results/rows here"):
        call("publish", ["tiny"])
    assert not Path("results").exists()


def test_no_other_command_writes_there(project, capsys):
    before = contents()
    assert call("tables", ["tiny"]) == 0 and call("tables", ["results/rows/tiny.csv"]) == 0
    assert contents() == before and Path("out/tables/tiny.md").is_file()


@pytest.mark.parametrize("path", ROWS, ids=lambda path: path.stem)
def test_committed_tables_follow_from_committed_rows(path):
    table = make_table(read_csv(path), title=path.stem, mixed=True)
    for suffix, text_of in FORMATS.items():
        assert (RESULTS / "tables" / f"{path.stem}.{suffix}").read_text() == text_of(table)


def test_every_committed_table_has_its_rows():
    tables = {path.name for path in (RESULTS / "tables").glob("*.*")}
    of_rows = {f"{path.stem}.{suffix}" for path in ROWS for suffix in FORMATS}
    assert tables == of_rows | {f"{path.stem}.{suffix}" for path in TIMES for suffix in TIME_FORMATS}


@pytest.mark.parametrize("path", TIMES, ids=lambda path: path.stem)
def test_committed_tables_of_times_follow_from_committed_rows(path):
    times = of_times.make_time_table(read_csv(path), title=path.stem)
    for suffix, text_of in TIME_FORMATS.items():
        assert (RESULTS / "tables" / f"{path.stem}.{suffix}").read_text() == text_of(times)


@pytest.mark.parametrize("path", ROWS, ids=lambda path: path.stem)
def test_committed_rows_name_files_by_their_place_in_the_project(path):
    sources = map(json.loads, distinct(read_csv(path), "task.source"))
    assert all(source["root"].startswith("./") for source in sources if "root" in source)
