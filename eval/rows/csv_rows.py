"""Rows read from a CSV of them, without pandas; :mod:`eval.rows.frame` makes tables of them and writes them.

The last column, :data:`COUNT`, is how many rows the file was written with, in each
of them: a file that lost its end is noticed wherever it was cut.
"""

from __future__ import annotations

import csv
import os
from functools import cache
from pathlib import Path
from typing import Any

from eval.rows.old_names import with_new_names
from eval.rows.store import PUBLISHED, Row, is_text, row_problem, schema_problem
from sshade.errors import InputError

#: Not a fact of a row: files of older versions lack it.
COUNT = "rows_in_file"


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The rows of a CSV; an empty cell is None.

    Raises
    ------
    InputError
        When the file is missing, is cut short, a line of it is no row, or its rows are of a newer schema.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; `sshade-eval collect` makes it from runs")
    try:  # not pandas' reader, which fills up a line that was cut
        with path.open(newline="", encoding="utf-8") as file:
            header, *lines = list(csv.reader(file)) or [[]]
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable CSV file ({error})") from error
    if not lines or "status" not in header:
        raise InputError(f"{path}: holds no rows of runs")
    text = [is_text(name) for name in header]
    rows = []
    for number, line in enumerate(lines, start=2):
        if len(line) != len(header):
            raise InputError(
                f"{path}: line {number} has another number of cells than the first; collect again"
            )
        row = {name: _value(cell, text=t) for name, cell, t in zip(header, line, text, strict=True)}
        written = row.pop(COUNT, len(lines))
        if written != len(lines):
            raise InputError(
                f"{path}: line {number} is of a file of {written} rows, but this one has {len(lines)}: "
                "it was cut, or put together by hand; collect again"
            )
        if problem := schema_problem(row):
            raise InputError(f"{path}: line {number} {problem}")
        if problem := row_problem(row):
            raise InputError(f"{path}: line {number} is not a row ({problem}); collect again")
        rows.append(with_new_names(row))
    return rows


def published_row(experiment: str, key: str) -> Row | None:
    """The row of a key in ``results/rows/<experiment>.csv`` beside the command; None where there is none."""
    path = PUBLISHED / "rows" / f"{experiment}.csv"
    return _by_key(path.resolve(), path.stat().st_mtime_ns).get(key) if path.is_file() else None


@cache
def _by_key(path: Path, written: int) -> dict[str, Row]:
    """The rows of a file by their keys; `written`, when it was, tells apart what the cache holds."""
    return {row["key"]: row for row in read_rows(path)}


def _value(cell: str, *, text: bool) -> Any:
    """The number or bool that a cell tells unless it is `text`, else what it says; None where it is empty."""
    if cell in ("true", "false") and not text:
        return cell == "true"
    for kind in () if text else (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell or None
