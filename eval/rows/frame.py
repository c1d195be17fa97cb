"""Rows of many runs as a pandas DataFrame: a line a run, a column a fact; read from CSV and written.

The cells are what ``row.json`` holds (numbers, strings, bools, None), so the
columns have dtype object; :func:`numbers` gives a column to compute with.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pandas as pd

from eval.rows.csv_rows import COUNT, read_rows
from eval.rows.store import VALID, Row, in_order
from sshade.errors import InputError
from sshade.io.files import make_folder, replacing

#: This project's methods, in the order of tables.
OURS = ("paper_plain", "paper", "fast", "fine", "fine_free")
#: What tells apart the runs of one method.
CASE = ["task.name", "seed"]

#: As far apart as the clocks of machines that share their runs may be.
CLOCKS_APART = timedelta(minutes=10)


def to_frame(rows: Iterable[Row]) -> pd.DataFrame:
    """Rows in the order given, columns in the fixed one; None where a row lacks a column."""
    rows = list(rows)
    names = in_order({name for row in rows for name in row})
    frame = pd.DataFrame(rows, columns=names, dtype=object)
    return frame.where(frame.notna(), None)


def records(rows: pd.DataFrame) -> list[Row]:
    """The rows as a list of mappings, as :func:`to_frame` takes them."""
    return rows.to_dict("records")


def numbers(rows: pd.DataFrame, column: str) -> pd.Series:
    """A column as float64: NaN where there is nothing, also where no row has the column."""
    return pd.to_numeric(rows.reindex(columns=[column])[column]).astype(float)


def distinct(rows: pd.DataFrame, column: str) -> list[Any]:
    """The values of a column, sorted, each once; none where no row has the column."""
    return sorted(rows.reindex(columns=[column])[column].replace("", None).dropna().unique())


def valid(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with a result."""
    return rows[rows["status"].isin(VALID)]


def newest(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each (method, its parameters, task, seed): the latest one, in a fixed order.

    Two rows have the same task if it has the same name and either the same
    checksum (so that copies of a dataset in different folders are one), or the
    same source (so that after a rebuild of a dataset the old rows give way).

    Raises
    ------
    InputError
        When a row is dated in the future: it would be the latest for a long time.
    """
    last = rows.sort_values("date").iloc[-1]
    if last["date"] > (datetime.now(UTC) + CLOCKS_APART).isoformat():
        raise InputError(
            f"the row of {last['method.name']} on {last['task.name']} is of the future, {last['date']}: the "
            "clock of its machine or of this one is wrong; remove the row, or set this clock"
        )
    for same_task in ("task.checksum", "task.source"):
        run = ["method.name", "method.hash", "task.name", same_task, "seed"]
        run = [name for name in run if name in rows]
        rows = rows.sort_values(["date", "key"], kind="stable").drop_duplicates(run, keep="last")
        rows = rows.sort_values(run, na_position="first")
    return rows.reset_index(drop=True)


def split_label(name: str) -> tuple[str, float | None]:
    """A method's label such as "arap-7000" as its family and the number; None where it ends with none."""
    family, _, number = name.rpartition("-")
    try:
        return (family, float(number)) if family else (name, None)
    except ValueError:
        return name, None


def method_names(rows: pd.DataFrame) -> list[str]:
    """The methods of rows in a table's order."""
    return sorted(rows["method.name"].unique(), key=method_order)


def method_order(name: str) -> tuple[int, list[str | float]]:
    """Return a sort key: others' methods by name, then this project's; 7000 before 25000."""
    family = name.split("-")[0].rpartition(" ")[2]
    parts: list[str | float] = list(re.split(r"(\d+(?:\.\d+)?)", name))
    parts[1::2] = map(float, parts[1::2])
    return OURS.index(family) if family in OURS else -1, parts


def write_csv(path: str | os.PathLike[str], rows: pd.DataFrame) -> None:
    """Write rows as CSV; the same rows give the same bytes."""
    # Not DataFrame.map, which would make floats of ints beside None.
    cells = pd.DataFrame({name: map(_cell, rows[name]) for name in in_order(rows)}, dtype=object)
    cells[COUNT] = len(rows)
    make_folder(Path(path).parent)
    with replacing(path) as temporary:
        cells.to_csv(temporary, index=False, lineterminator="\n")


def read_csv(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read rows back, as :func:`eval.rows.csv_rows.read_rows` does; an empty cell is None."""
    return to_frame(read_rows(path))


def _cell(value: Any) -> Any:
    """A value as it stands in a CSV: bools in lower case, the rest as pandas writes it."""
    return str(value).lower() if isinstance(value, bool) else value
