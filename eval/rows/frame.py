"""Rows as a pandas DataFrame, one line per run; read and write CSV files.

Cells hold the values of ``row.json`` (numbers, strings, bools, None), so columns have dtype object. To
compute with a column, use :func:`numbers`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from typing import Any

import pandas as pd

from eval.rows.csv_rows import COUNT, read_rows
from eval.rows.files import writing
from eval.rows.store import VALID, Row, in_order

#: This project's methods, in the order of tables.
OURS = ("paper_plain", "paper", "fast", "fine", "fine_free")
#: Columns that identify a run of a method.
CASE = ["task.name", "seed"]


def to_frame(rows: Iterable[Row]) -> pd.DataFrame:
    """Make a DataFrame of rows, with columns in the fixed order; a missing value becomes None."""
    rows = list(rows)
    names = in_order({name for row in rows for name in row})
    frame = pd.DataFrame(rows, columns=names, dtype=object)
    return frame.where(frame.notna(), None)


def records(rows: pd.DataFrame) -> list[Row]:
    """Return the rows as a list of mappings, the input of :func:`to_frame`."""
    return rows.to_dict("records")


def numbers(rows: pd.DataFrame, column: str) -> pd.Series:
    """Return a column as float64, with NaN for missing values and missing columns."""
    return pd.to_numeric(rows.reindex(columns=[column])[column]).astype(float)


def distinct(rows: pd.DataFrame, column: str) -> list[Any]:
    """Return the distinct values of a column, sorted; empty if no row has the column."""
    return sorted(rows.reindex(columns=[column])[column].replace("", None).dropna().unique())


def valid(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with a result."""
    return rows[rows["status"].isin(VALID)]


def newest(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the latest row of each method with its parameters and version, task and seed, in a fixed order.

    Two rows have the same task if its name and either its checksum or its source are equal. Equal checksums
    join copies of a dataset in different folders. With equal sources, rows of a rebuilt dataset replace
    rows of the earlier build. Rows of an older version of a method give way to rows of the newest.
    """
    rows = rows.sort_values(["method.version", "measures", "date", "key"], kind="stable")
    for same_task in ("task.checksum", "task.source"):
        run = ["method.name", "method.hash", "task.name", same_task, "seed"]
        run = [name for name in run if name in rows]
        rows = rows.drop_duplicates(run, keep="last")
    return rows.sort_values(run, na_position="first").reset_index(drop=True)


def method_names(rows: pd.DataFrame) -> list[str]:
    """Return the methods of rows in the order of a table."""
    return sorted(rows["method.name"].unique(), key=method_order)


def method_order(name: str) -> tuple[int, list[str | float]]:
    """Return a sort key: others' methods by name, then this project's; 7000 before 25000."""
    family = name.split("-")[0].rpartition(" ")[2]
    parts: list[str | float] = list(re.split(r"(\d+(?:\.\d+)?)", name))
    parts[1::2] = map(float, parts[1::2])
    return OURS.index(family) if family in OURS else -1, parts


def write_csv(path: str | os.PathLike[str], rows: pd.DataFrame) -> None:
    """Write rows as CSV; equal rows give equal bytes."""
    # DataFrame.map would turn integers in a column with None into floats.
    cells = pd.DataFrame({name: map(_cell, rows[name]) for name in in_order(rows)}, dtype=object)
    cells[COUNT] = len(rows)
    with writing(path) as temporary:
        cells.to_csv(temporary, index=False, lineterminator="\n")


def read_csv(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read rows back, as :func:`eval.rows.csv_rows.read_rows` does; an empty cell is None."""
    return to_frame(read_rows(path))


def _cell(value: Any) -> Any:
    """Return the value of a CSV cell: bools in lower case, and line breaks that every reader quotes."""
    if isinstance(value, str):
        return value.replace("\r", "\n")
    return str(value).lower() if isinstance(value, bool) else value
