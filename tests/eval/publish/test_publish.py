"""Only ``tables --publish`` changes committed results; committed rows, tables and figures agree."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from eval.publish.summary import make_table
from eval.publish.tables import FORMATS
from eval.rows.frame import distinct, read_csv, write_csv
from tests.full import few
from tests.kernels import OFFERED

RESULTS = Path(__file__).parents[3] / "results"
ROWS = sorted((RESULTS / "rows").glob("*.csv"))
#: Tables that take a second and more.
SLOW = ("bodies_170k", "bodies_25k", "faust_170k", "faust_low", "front_detail", "noisy_170k", "noisy_2mm")
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


@pytest.mark.parametrize("path", few(ROWS, *QUICK), ids=lambda path: path.stem)
def test_committed_rows_are_written_again_give_the_tables_and_name_files_in_the_project(path, tmp_path):
    rows = read_csv(path)
    write_csv(tmp_path / "again.csv", rows)
    assert (tmp_path / "again.csv").read_bytes() == path.read_bytes()
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
