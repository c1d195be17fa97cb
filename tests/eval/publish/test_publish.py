"""Only ``tables --publish`` changes committed results; committed rows, tables and figures agree."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from eval_rows import frame, row

from eval.main import call
from eval.publish.summary import make_table
from eval.publish.tables import FORMATS, to_markdown
from eval.rows.frame import distinct, read_csv, records, write_csv
from sshade import InputError
from tests.files import contents
from tests.full import few
from tests.kernels import OFFERED

RESULTS = Path(__file__).parents[3] / "results"
ROWS = sorted((RESULTS / "rows").glob("*.csv"))
#: Tables that take a second and more.
SLOW = ("bodies_170k", "bodies_25k", "front_detail", "noisy_170k", "noisy_2mm")
QUICK = [path for path in ROWS if path.stem not in SLOW]
TIMES = sorted((RESULTS / "timing").glob("*.csv"))
#: Program that prints the tables of rows in every format.
REMAKE = """
import sys
from pathlib import Path
from eval.publish.summary import make_table
from eval.publish.tables import FORMATS
from eval.rows.frame import read_csv
for path in map(Path, sys.argv[1:]):
    table = make_table(read_csv(path), title=path.stem)
    print(*(text_of(table) for text_of in FORMATS.values()), sep="", end="")
"""


def clean(method="arap", task="t1", **changes):
    """Return a row from a clean checkout."""
    facts = {"env.commit": "1", "env.modified": False}
    return row(method, task) | facts | {name.replace("__", "."): value for name, value in changes.items()}


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
    assert call("tables", ["tiny", "--publish"]) == 0
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
        call("tables", ["tiny", "other", "--publish"])
    with pytest.raises(InputError, match="out/rows/nothing.csv: no such file"):
        call("tables", ["tiny", "nothing", "--publish"])
    assert contents("results") == before


def test_newer_rows_and_versions_take_the_place_of_published_ones(project):
    old = [clean("a"), clean("b"), clean("c"), clean("c", "t2"), clean("d")]
    write_csv("results/rows/tiny.csv", frame(*old))
    new = [clean("a", date="2026-01-02"), clean("b", date="2025-01-01"), clean("c", method__version=2)]
    write_csv("out/rows/tiny.csv", frame(*new))
    with pytest.raises(InputError, match="newer version of c or of the measures, of which 1 run of .* t2"):
        call("tables", ["tiny", "--publish"])
    write_csv("out/rows/tiny.csv", frame(*new, clean("c", "t2", method__version=2)))
    assert call("tables", ["tiny", "--publish"]) == 0
    rows = published()
    assert sorted(rows) == [*((name, "t1") for name in "abc"), ("c", "t2"), ("d", "t1")]
    assert {rows["c", task]["method.version"] for task in ("t1", "t2")} == {2}  # older ones would mix with it
    assert [rows[name, "t1"]["date"] for name in "ab"] == ["2026-01-02", "2026-01-01"]


def test_rows_of_other_parameters_take_the_place_of_published_ones_if_all_cases_were_run_again(project):
    write_csv("results/rows/tiny.csv", frame(clean("a"), clean("a", "t2"), clean("b")))
    again = [clean("a", task, method__hash="other") for task in ("t1", "t2")]
    write_csv("out/rows/tiny.csv", frame(again[0]))
    with pytest.raises(InputError, match="method 'a' has rows of different parameters"):
        call("tables", ["tiny", "--publish"])
    write_csv("out/rows/tiny.csv", frame(*again))
    assert call("tables", ["tiny", "--publish"]) == 0
    assert {key: found["method.hash"] == "other" for key, found in published().items()} == {
        ("a", "t1"): True,
        ("a", "t2"): True,
        ("b", "t1"): False,
    }


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([clean(), clean("b", env__modified=True)], "1 of 2 rows .* not committed, or from no commit"),
        ([clean(), clean("b", method__target="mine.method")], "no part of this project.*CONTRIBUTING"),
        (
            [clean("b", **{"method.target": "sshade.deform", "method.proxy_method.target": "mine.own"})],
            "no part of th",
        ),
        ([clean("p", method__command="[mine]")], "no part of this project"),
    ],
    ids=["modified", "a user's", "a user's on a proxy", "a program"],
)
def test_what_is_not_of_one_commit_of_this_project_is_not_published(project, rows, told):
    write_csv("out/rows/other.csv", frame(*rows))
    before = contents("results")
    with pytest.raises(InputError, match=told):
        call("tables", ["tiny", "other", "--publish"])
    assert contents("results") == before


@pytest.mark.parametrize("path", few(ROWS, *QUICK), ids=lambda path: path.stem)
def test_committed_tables_follow_from_committed_rows_which_name_files_by_their_place_in_the_project(path):
    rows = read_csv(path)
    table = make_table(rows, title=path.stem)
    for suffix, text_of in FORMATS.items():
        assert (RESULTS / "tables" / f"{path.stem}.{suffix}").read_text() == text_of(table)
    sources = map(json.loads, distinct(rows, "task.source"))
    assert not any(Path(source["root"]).is_absolute() for source in sources if "root" in source)


@pytest.mark.parametrize("kernels", few(OFFERED, OFFERED[0]) if len(OFFERED) > 1 else OFFERED)
@pytest.mark.parametrize(
    ("paths", "threads"),
    [
        ([path for path in ROWS if path.stem in ("noisy_170k", "bodies_170k")], "2"),
        *(pytest.param(ROWS, threads, marks=pytest.mark.full) for threads in "12"),
    ],
)
def test_committed_tables_depend_neither_on_the_kernels_of_a_library_nor_on_threads(kernels, threads, paths):
    variables = {"OPENBLAS_CORETYPE": kernels, "OPENBLAS_NUM_THREADS": threads}
    program = [sys.executable, "-c", REMAKE, *map(str, paths)]
    done = subprocess.run(program, env=os.environ | variables, capture_output=True, text=True, check=True)
    tables = RESULTS / "tables"
    made = "".join((tables / f"{path.stem}.{end}").read_text() for path in paths for end in FORMATS)
    assert done.stdout == made


def test_every_committed_table_has_its_rows():
    tables = {path.name for path in (RESULTS / "tables").glob("*.*")}
    of_rows = {f"{path.stem}.{suffix}" for path in ROWS for suffix in FORMATS}
    assert tables == of_rows | {f"{path.stem}.{suffix}" for path in TIMES for suffix in ("csv", "md")}
