"""The paper's numbers beside yours: ``sshade-eval tables --paper faust tosca``.

A dataset has a table with a line for each number in ``conf/paper.yaml``. A line has
the number of the paper, the mean of the valid rows in ``out/rows``, and the number of cases of the mean.
`make verify FAUST=DIR TOSCA=DIR` makes the rows first.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from eval.publish.columns import COLUMNS, TRANSFER_COLUMNS, Column
from eval.publish.markdown import markdown_table
from eval.rows.files import ROWS, RUNS, read_conf
from eval.rows.frame import CASE, newest, numbers, read_csv, valid
from sshade.core.errors import InputError

#: Columns by the measures of conf/paper.yaml.
MEASURES = {
    column.heading: column
    for column in (*COLUMNS, *TRANSFER_COLUMNS, Column("time", "s", "seconds.total", 1))
}
HEAD = ("experiment", "method", "measure", "paper", "yours", "cases")


def table(dataset: str, paper: dict[str, Any], folder: Path) -> str:
    """Return the table of a dataset in Markdown.

    Parameters
    ----------
    dataset : str
        Tag of the rows: the CSV is ``<experiment>_<dataset>.csv``.
    paper : dict
        The paper's numbers by experiment, method and measure.
    folder : path
        Folder of the CSV files. A method without rows has an empty mean.
    """
    body = []
    for experiment, methods in paper.items():
        rows = _rows(folder / f"{experiment}_{dataset}.csv")
        for method, measures in methods.items():
            for measure, number in measures.items():
                column = MEASURES[measure]
                found = numbers(rows[rows["method.name"] == method], column.source).dropna()
                mean = column.text(found.mean()) if len(found) else ""
                body.append((experiment, method, column.label, column.text(number), mean, str(len(found))))
    return markdown_table(HEAD, body, left=HEAD[:3])


def _rows(path: Path) -> pd.DataFrame:
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
    known = read_conf("paper")
    for dataset in datasets:
        if dataset not in known:
            raise InputError(f"the paper has no numbers of {dataset}; name one of {', '.join(known)}")
        if not list(ROWS.glob(f"*_{dataset}.csv")):
            raise InputError(f"{ROWS} has no rows of {dataset}; `make verify` makes them")
    return "\n".join(f"### {dataset}\n\n{table(dataset, known[dataset], ROWS)}\n" for dataset in datasets)
