"""Claims of the pages on rows of your own data: ``sshade-eval claims faust``.

The command compares means of two methods for each claim in ``conf/claims.yaml``, over the cases that both
have in ``out/rows``. It prints a table and writes the table to ``out/tables``. The last column is

  confirmed   the 95 % interval of the difference over three subjects or more supports the claim
  refuted     the interval supports the opposite
  undecided   the interval contains zero
  seen        the means support the claim, for one or two subjects
  not seen    the means do not support the claim, for one or two subjects
  no rows     a method has no valid row, or the two methods have no common case

`make verify FAUST=DIR TOSCA=DIR` makes all rows first.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from eval.publish.columns import COLUMNS, TRANSFER_COLUMNS
from eval.publish.comparison import subjects_of
from eval.publish.intervals import LEAST, interval
from eval.publish.markdown import markdown_table
from eval.rows.files import ROWS, RUNS, add_out, read_conf, write_text
from eval.rows.frame import CASE, newest, numbers, read_csv, valid
from sshade.errors import InputError

#: Columns of rows by the measures that claims name.
SOURCES = {column.heading: column.source for column in (*COLUMNS, *TRANSFER_COLUMNS)}
SOURCES |= {"time": "seconds.total"}
#: Units of measures, for the table.
UNITS = {column.heading: column.unit for column in (*COLUMNS, *TRANSFER_COLUMNS)} | {"time": "s"}
LABELS = ("claim", "measure", "yours", "the paper's", "subjects", "cases", "result")


class Finding(NamedTuple):
    """Means of both sides of a claim, the number of subjects and cases, and the result."""

    left: float
    right: float
    subjects: int
    cases: int
    result: str


def read_claims() -> dict[str, list[dict[str, str]]]:
    """Return the claims by dataset."""
    return read_conf("claims")


def examine(claim: Mapping[str, str], dataset: str, folder: Path = ROWS) -> Finding:
    """Compare the two sides of a claim.

    Parameters
    ----------
    claim : mapping
        An entry of ``conf/claims.yaml``.
    dataset : str
        Tag of the rows: the CSV is ``<experiment>_<dataset>.csv``.
    folder : path
        Folder of the CSV files.
    """
    left, sign, right = re.split(r" ([<>]) ", claim["holds"])
    column = SOURCES[claim["measure"]]
    values = pd.DataFrame({"left": _values(folder, left, dataset, column)})
    values["right"] = _values(folder, right, dataset, column) if " " in right else float(right)
    values = values.dropna()
    if values.empty:
        return Finding(np.nan, np.nan, 0, 0, "no rows")
    of_subjects = values.groupby(level="subject").mean()
    means, difference = of_subjects.mean(), of_subjects["left"] - of_subjects["right"]
    if sign == ">":
        difference = -difference
    low, high = (end.item() for end in interval(difference.to_numpy()[:, None]))
    if len(of_subjects) < LEAST:
        result = "seen" if difference.mean() < 0 else "not seen"
    else:
        result = "confirmed" if high < 0 else "refuted" if low > 0 else "undecided"
    return Finding(means["left"], means["right"], len(of_subjects), len(values), result)


def _values(folder: Path, side: str, dataset: str, column: str) -> pd.Series:
    """Return the means over seeds of a method's valid rows, by subject and case; empty without rows."""
    experiment, method = side.split(" ")
    rows = _rows(folder / f"{experiment}_{dataset}.csv")
    rows = rows[rows["method.name"] == method] if len(rows) else rows.reindex(columns=["task.name"])
    subject = rows["task.name"].map(subjects_of(rows)).rename("subject")
    return numbers(rows, column).groupby([subject, rows["task.name"]]).mean()


@cache
def _rows(path: Path) -> pd.DataFrame:
    """Return the newest valid rows of a CSV; none without the file.

    Raises
    ------
    InputError
        When two rows of a method and a case have different settings or data.
    """
    if not path.is_file():
        return pd.DataFrame()
    rows = valid(newest(read_csv(path)))
    repeated = rows[rows.duplicated(["method.name", *CASE])].to_dict("records")
    if repeated:
        raise InputError(
            f"{path} has two rows of {repeated[0]['method.name']} on {repeated[0]['task.name']}, with "
            f"different settings or data; remove {RUNS / path.stem} and {path}, and run the experiment again"
        )
    return rows


def table(dataset: str, folder: Path = ROWS) -> str:
    """Return the table of all claims about a dataset, in Markdown."""
    body = []
    for claim in read_claims()[dataset]:
        found = examine(claim, dataset, folder)
        seen = "<" if found.left < found.right else ">" if found.left > found.right else "="
        unit = f" ({UNITS[claim['measure']]})" if UNITS[claim["measure"]] else ""
        yours = f"{found.left:.4g} {seen} {found.right:.4g}" if found.cases else ""
        facts = str(found.subjects), str(found.cases), found.result
        body.append((claim["says"], f"{claim['measure']}{unit}", yours, str(claim.get("paper", "")), *facts))
    return markdown_table(LABELS, body, left=(*LABELS[:2], LABELS[-1]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("datasets", nargs="+", metavar="DATASET", help=" or ".join(read_claims()))
    add_out(parser, Path("out/tables"), "folder of the tables")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    known = read_claims()
    for dataset in options.datasets:
        if dataset not in known:
            raise InputError(f"conf/claims.yaml has no claims about {dataset!r}; use {' or '.join(known)}")
        if not list(ROWS.glob(f"*_{dataset}.csv")):
            raise InputError(f"{ROWS} has no rows of {dataset}; `make verify` makes them")
    for dataset in options.datasets:
        text = f"### Claims on {dataset}\n\n{table(dataset)}\n"
        write_text(options.out / f"claims_{dataset}.md", text)
        print(text)  # noqa: T201
    return 0
