"""Read rows from a CSV file, without pandas; :mod:`eval.rows.frame` writes the file.

The last column, :data:`COUNT`, holds the number of rows of the file in every row. It shows where a file was
cut.
"""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Any

from eval.rows.store import Row, is_text, row_problem, schema_problem
from sshade.core.errors import InputError

#: Column with the number of rows in the file.
COUNT = "rows_in_file"
#: Largest number of letters of a cell, such as a reason with all numbers of an array; Python reads 131,072.
LONGEST = 2**31 - 1


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """Read the rows of a CSV; an empty cell is None.

    Raises
    ------
    InputError
        When the file is missing or cut, a line is not a row, or the rows have a newer schema.
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
        if problem := schema_problem(row):
            raise InputError(f"{path}: line {number} {problem}")
        if problem := row_problem(row):
            raise InputError(f"{path}: line {number} is not a row ({problem}); collect again")
        rows.append(row)
    return rows


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
