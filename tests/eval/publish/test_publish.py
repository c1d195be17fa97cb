"""Only ``sshade-eval publish`` changes committed results; committed rows, tables and figures agree."""

import json
import os
from pathlib import Path

import pytest
from eval_rows import frame, planned, row

from eval.main import call
from eval.publish import publish
from eval.publish.summary import make_table
from eval.publish.tables import FORMATS, to_markdown
from eval.rows.frame import distinct, read_csv, records, write_csv
from eval.timing import table as of_times
from sshade.core.errors import InputError
from tests.files import contents

RESULTS = Path(__file__).parents[3] / "results"
ROWS = sorted((RESULTS / "rows").glob("*.csv"))
TIMES = sorted((RESULTS / "timing").glob("*.csv"))
TIME_FORMATS = {"csv": of_times.to_csv, "md": of_times.to_markdown}


def clean(method="arap", task="t1", **changes):
    """Return a row of code version c from a clean checkout."""
    facts = {"env.commit": "1", "env.modified": False, "env.version.code": "c", "env.version.metrics": "m"}
    return row(method, task) | facts | {name.replace("__", "."): value for name, value in changes.items()}


def lacking(method, task):
    return planned(method, task) | {"task.source": f'{{"task": "{task}"}}'}


def published():
    return {(r["method.name"], r["task.name"]): r for r in records(read_csv("results/rows/tiny.csv"))}


@pytest.fixture
def project(here):
    """Make a project with published rows of one experiment and new rows of two experiments."""
    write_csv("results/rows/tiny.csv", frame(clean("early")))
    for name in ("tiny", "other"):
        write_csv(f"out/rows/{name}.csv", frame(clean("arap"), clean("paper")))
    Path("out/figures").mkdir()
    Path("out/figures/tiny.png").write_bytes(b"a picture")
    return here


def test_rows_tables_and_figures_go_where_they_are_committed(project):
    assert call("publish", ["tiny"]) == 0
    found = contents("results")
    tables = [f"tables/tiny.{suffix}" for suffix in sorted(FORMATS)]
    assert list(found) == ["figures/tiny.png", "rows/tiny.csv", *tables]
    rows = read_csv("results/rows/tiny.csv")
    assert sorted(rows["method.name"]) == ["arap", "early", "paper"]
    table = to_markdown(make_table(rows, title="tiny"))
    assert found["tables/tiny.md"].decode() == table
    assert found["figures/tiny.png"] == b"a picture"


def test_all_is_checked_before_anything_changes(project):
    before = contents("results")
    write_csv("out/rows/other.csv", frame(clean("a"), clean("a", "t2", method__hash="other")))
    with pytest.raises(InputError, match="different parameters"):
        call("publish", ["tiny", "other"])
    with pytest.raises(InputError, match="out/rows/nothing.csv: no such file"):
        call("publish", ["tiny", "nothing"])
    assert contents("results") == before


def test_newer_rows_of_a_version_take_the_place_of_published_ones_and_of_missing(project):
    write_csv("results/rows/tiny.csv", frame(clean("a"), clean("b"), lacking("c", "t1"), lacking("d", "t1")))
    new = [clean("a", date="2026-01-02"), clean("b", date="2025-01-01"), clean("c"), lacking("e", "t2")]
    source = lacking("", "t1")["task.source"]
    write_csv("out/rows/tiny.csv", frame(*(r | {"task.source": r.get("task.source", source)} for r in new)))
    publish.joined("tiny", replace=False).pipe(lambda rows: write_csv("results/rows/tiny.csv", rows))
    rows = published()
    assert {run: row["status"] for run, row in rows.items()} == {
        **{(method, "t1"): "ok" for method in "abc"},
        ("d", "t1"): "missing",
        ("e", "t2"): "missing",
    }
    assert [rows[method, "t1"]["date"] for method in "ab"] == ["2026-01-02", "2026-01-01"]


@pytest.mark.parametrize("name", ["env__version__code", "env__version__metrics"])
def test_another_version_replaces_the_published_one_only_if_asked(project, name):
    write_csv("results/rows/tiny.csv", frame(clean("early", **{name: None}), lacking("late", "t9")))
    before = contents("results")
    told = r"tiny.csv has rows of version \w+ \(metrics \w+\): 1, and out/rows/tiny.csv of version c"
    with pytest.raises(InputError, match=rf"{told} \(metrics m\): 2: --replace removes .* rows of early"):
        call("publish", ["tiny"])
    assert contents("results") == before
    assert call("publish", ["tiny", "--replace"]) == 0
    assert sorted(published()) == [("arap", "t1"), ("late", "t9"), ("paper", "t1")]


def test_rows_of_other_methods_keep_their_version(project):
    earlier = [clean(name, env__version__code="b") for name in ("arap", "early")]
    write_csv("results/rows/tiny.csv", frame(*earlier))
    with pytest.raises(InputError, match="--replace removes the published rows of arap$"):
        call("publish", ["tiny"])
    assert call("publish", ["tiny", "--replace"]) == 0
    versions = {name: row["env.version.code"] for (name, _), row in published().items()}
    assert versions == {"arap": "c", "early": "b", "paper": "c"}
    text = Path("results/tables/tiny.md").read_text(encoding="utf-8")
    assert "Code: version b, c, metrics m, commit 1, clean tree." in text


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (
            [clean(), clean("b", env__modified=True)],
            r"1 of 2 rows .* not committed, or from no commit \(b: 1\)",
        ),
        (
            [clean(env__commit="", env__modified=None)],
            r"1 of 1 rows of out/rows/other.csv .* \(arap: 1\): commit",
        ),
        (
            [clean(), clean("b", env__version__code="d"), clean("c", env__version__metrics="n")],
            r"version c \(metrics m\): 1, version c \(metrics n\): 1, version d \(metrics m\): 1; the rows",
        ),
        (
            [clean(), clean(task="t2", env__version__code="d")],
            r"version c \(metrics m\): 1, version d \(metrics m\): 1; the rows",
        ),
        (
            [clean("a", method__target="baselines.arap.arap"), clean("b", method__target="mine.method")],
            r"1 of 2 rows .* no part of this project \(b: 1\).*propose the methods as CONTRIBUTING",
        ),
        (
            [clean("b", **{"method.target": "sshade.sshade", "method.coarse.target": "mine.method"})],
            r"1 of 1 rows .* no part of this project \(b: 1\)",
        ),
        ([lacking("a", "t1")], r"out/rows/other.csv has no rows of runs yet"),
    ],
    ids=["modified", "no commit", "metrics", "a method", "a user's", "a user's on a proxy", "nothing ran"],
)
def test_what_is_not_of_one_version_and_commit_is_not_published(project, rows, told):
    write_csv("out/rows/other.csv", frame(*rows))
    before = contents("results")
    with pytest.raises(InputError, match=told):
        call("publish", ["tiny", "other", "--replace"])
    assert contents("results") == before


def test_a_figure_may_stand_alone_but_not_be_older_than_its_rows(project):
    Path("out/figures/front.svg").write_text("<svg/>")
    assert call("publish", ["front"]) == 0 and contents("results")["figures/front.svg"] == b"<svg/>"
    os.utime("out/figures/tiny.png", (0, 0))
    with pytest.raises(InputError, match="tiny.png is older than out/rows/tiny.csv"):
        call("publish", ["tiny"])


@pytest.mark.parametrize("path", ROWS, ids=lambda path: path.stem)
def test_committed_tables_follow_from_committed_rows_which_name_files_by_their_place_in_the_project(path):
    rows = read_csv(path)
    table = make_table(rows, title=path.stem, mixed=True)
    for suffix, text_of in FORMATS.items():
        assert (RESULTS / "tables" / f"{path.stem}.{suffix}").read_text() == text_of(table)
    sources = map(json.loads, distinct(rows, "task.source"))
    assert not any(Path(source["root"]).is_absolute() for source in sources if "root" in source)


def test_every_committed_table_has_its_rows():
    tables = {path.name for path in (RESULTS / "tables").glob("*.*")}
    of_rows = {f"{path.stem}.{suffix}" for path in ROWS for suffix in FORMATS}
    assert tables == of_rows | {f"{path.stem}.{suffix}" for path in TIMES for suffix in TIME_FORMATS}


@pytest.mark.parametrize("path", TIMES, ids=lambda path: path.stem)
def test_committed_tables_of_times_follow_from_committed_rows(path):
    times = of_times.make_time_table(read_csv(path), title=path.stem)
    for suffix, text_of in TIME_FORMATS.items():
        assert (RESULTS / "tables" / f"{path.stem}.{suffix}").read_text() == text_of(times)
