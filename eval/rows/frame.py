"""Rows as a pandas DataFrame, one line per run; read and write CSV files.

Cells hold the values of ``row.json`` (numbers, strings, bools, None), so columns have dtype object. To
compute with a column, use :func:`numbers`.

The last column of a CSV, :data:`COUNT`, holds the number of rows of the file in every row. It shows where a
file was cut.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from eval.rows.files import writing
from eval.rows.store import TRUE_POSE, VALID, Row, in_order, is_text, row_problem
from sshade.core.errors import InputError

#: This project's methods, in the order of tables.
OURS = ("paper_plain", "paper", "fast", "fine", "fine_free")
#: Columns that identify a run of a method.
CASE = ["task.name", "seed"]
#: Column with the number of rows in the file.
COUNT = "rows_in_file"
#: Largest number of letters of a cell, such as a reason with all numbers of an array; Python reads 131,072.
LONGEST = 2**31 - 1


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
    """Return a column as float64, with NaN for missing values, missing columns, and texts of methods."""
    errors: Literal["coerce", "raise"] = "coerce" if column.startswith("extra.") else "raise"
    return pd.to_numeric(rows.reindex(columns=[column])[column], errors=errors).astype(float)


def distinct(rows: pd.DataFrame, column: str) -> list[Any]:
    """Return the distinct values of a column, sorted; empty if no row has the column."""
    return sorted(rows.reindex(columns=[column])[column].replace("", None).dropna().unique())


def valid(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with a result."""
    return rows[rows["status"].isin(VALID)]


def of_methods(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows without those of true poses."""
    return rows[rows["method.name"] != TRUE_POSE]


def newest(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the latest row of each method with its parameters and version, task and seed, in a fixed order.

    Two rows have the same task if its name and either its checksum or its source are equal. Equal checksums
    join copies of a dataset in different folders. With equal sources, rows of a rebuilt dataset replace
    rows of the earlier build. Rows of an older version of a method give way to rows of the newest.
    """
    if "task.source" in rows:
        rows = rows.copy()
        rows["task.source"] = rows["task.source"].map(_plain_source)
    rows = rows.sort_values(["method.version", "measures", "date", "key"], kind="stable")
    for same_task in ("task.checksum", "task.source"):
        run = ["method.name", "method.hash", "task.name", same_task, "seed"]
        run = [name for name in run if name in rows]
        rows = rows.drop_duplicates(run, keep="last")
    return rows.sort_values(run, na_position="first").reset_index(drop=True)


def _plain_source(source: object) -> object:
    """Return a source whose folder has no dots: ``./data`` is ``data``."""
    return source.replace('"root": "./', '"root": "') if isinstance(source, str) else source


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
    """Read rows back; an empty cell is None.

    Raises
    ------
    InputError
        When the file is missing or cut, or a line is not a row.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; `sshade-eval collect` makes rows of runs, `sshade-eval bench` of times"
        )
    try:  # pandas would fill up the cells of a cut line
        csv.field_size_limit(LONGEST)
        with path.open(newline="", encoding="utf-8-sig") as file:  # a spreadsheet writes a byte-order mark
            header, *lines = list(csv.reader(file)) or [[]]
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable CSV file ({error})") from error
    if not lines or "status" not in header:
        raise InputError(f"{path}: holds no rows of runs")
    text = [is_text(name) for name in header]
    rows = []
    for number, line in enumerate(lines, start=2):
        if len(line) != len(header):
            raise InputError(f"{path}: line {number} has more or fewer cells than the first; collect again")
        row = {name: _value(cell, text=t) for name, cell, t in zip(header, line, text, strict=True)}
        written = row.pop(COUNT, len(lines))
        if written != len(lines):
            raise InputError(
                f"{path}: line {number} is of a file of {written!r} rows, but this file has {len(lines)}: "
                "it was cut, or edited by hand; collect again"
            )
        if problem := row_problem(row):
            raise InputError(f"{path}: line {number} is not a row ({problem}); collect again")
        rows.append(row)
    return to_frame(rows)


def _value(cell: str, *, text: bool) -> Any:
    """Convert a cell to a number or bool if possible, unless the column is `text`; None if it is empty."""
    if cell.lower() in ("true", "false") and not text:  # a spreadsheet writes TRUE
        return cell.lower() == "true"
    for kind in () if text else (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell or None


def _cell(value: Any) -> Any:
    """Return the value of a CSV cell: bools in lower case, and line breaks that every reader quotes."""
    if isinstance(value, str):
        return value.replace("\r", "\n")
    return str(value).lower() if isinstance(value, bool) else value
