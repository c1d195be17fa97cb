"""The paper's numbers beside ours: ``sshade-eval tables --paper faust tosca``, and in ``docs/paper.md``.

An experiment in ``conf/paper.yaml`` has a table with a line for each method. A cell has the number of the
paper, and the mean of the valid rows. `make verify FAUST=DIR TOSCA=DIR` makes the rows in ``out/rows`` first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from eval.publish.columns import COLUMNS, TRANSFER_COLUMNS, Column, markdown_table
from eval.rows.files import ROWS, RUNS, read_conf
from eval.rows.frame import CASE, newest, numbers, read_csv, valid
from sshade.core.errors import InputError

#: Columns by the measures of conf/paper.yaml.
MEASURES = {
    column.heading: column
    for column in (*COLUMNS, *TRANSFER_COLUMNS, Column("time", "s", "seconds.total", 1))
}
#: Entry of conf/paper.yaml with published rows instead of a dataset.
PUBLISHED = "published"
#: A number that is missing.
NONE = "-"


def beside(methods: dict[str, dict[str, float]], rows: pd.DataFrame) -> list[list[str]]:
    """Return the lines of an experiment's table, the head first.

    Parameters
    ----------
    methods : dict
        The paper's numbers by method and measure.
    rows : DataFrame
        Our rows. Without any, the table has the paper's numbers alone.
    """
    columns = [MEASURES[name] for name in dict.fromkeys(name for own in methods.values() for name in own)]
    lines = [["method", "cases", *(column.label for column in columns)]]
    for method, measures in methods.items():
        own = rows[rows["method.name"] == method]
        cells = [_pair(column, measures.get(column.heading), own) for column in columns]
        lines.append([method, str(len(own)), *cells])
    return lines


def _pair(column: Column, number: float | None, rows: pd.DataFrame) -> str:
    """Return the number of the paper and the mean of rows, or that one of them is missing."""
    mean = numbers(rows, column.source).mean()
    if number is None and pd.isna(mean):
        return NONE
    found = (math.nan if number is None else number, mean)
    return " / ".join(NONE if math.isnan(value) else column.text(value) for value in found)


def rows_beside(path: Path) -> pd.DataFrame:
    """Return the newest valid rows of a CSV; none without the file.

    Raises
    ------
    InputError
        When two rows of a method and a case have different settings or data.
    """
    if not path.is_file():
        return pd.DataFrame(columns=["method.name"])
    rows = valid(newest(read_csv(path)))
    repeated = rows[rows.duplicated(["method.name", *CASE])].to_dict("records")
    if repeated:
        raise InputError(
            f"{path} has two rows of {repeated[0]['method.name']} on {repeated[0]['task.name']}, with "
            f"different settings or data; remove {RUNS / path.stem} and {path}, and run the experiment again"
        )
    return rows


def paper_tables(datasets: Sequence[str]) -> str:
    """Return the tables of datasets, from the rows in out/rows.

    Raises
    ------
    InputError
        On an unknown dataset, or without rows.
    """
    known = {name: own for name, own in read_conf("paper").items() if name != PUBLISHED}
    text = "The number of the paper / your mean; cases: your cases.\n"
    for dataset in datasets:
        if dataset not in known:
            raise InputError(f"the paper has no numbers of {dataset}; name one of {', '.join(known)}")
        if not list(ROWS.glob(f"*_{dataset}.csv")):
            raise InputError(f"{ROWS} has no rows of {dataset}; `make verify` makes them")
        for experiment, methods in known[dataset].items():
            head, *body = beside(methods, rows_beside(ROWS / f"{experiment}_{dataset}.csv"))
            text += f"\n### {experiment}, {dataset}\n\n{markdown_table(head, body, left=head[:1])}\n"
    return text
