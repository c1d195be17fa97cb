"""The rows of quality beside times: what is timed must give the shape that was measured."""

from __future__ import annotations

from functools import cache
from typing import Any

from eval.rows.files import PUBLISHED, ROWS
from eval.rows.frame import read_csv, records, valid
from eval.rows.store import Row
from sshade.core.errors import InputError

#: Measures that must agree, and their largest relative and absolute difference, in the unit of the measure.
#: The targets of a timed call are moved by a hair, and rows may come from another processor.
COMPARED = tuple(f"metric.{name}" for name in ("volume", "area", "edge", "angle", "truth_distance"))
RELATIVE, ABSOLUTE = 0.01, 0.002
#: Columns that say of which run a row is, and columns of a method that say nothing of its settings.
RUN = ("task.checksum", "method.target", "method.version", "measures", "seed")
NAMES = ("method.name", "method.hash", "method.note")
#: Text where no row is of an equal run.
NO_ROW = "no row"


def require_quality(row: Row) -> str:
    """Compare the measures of a timed call with rows of equal runs; return their files, or :data:`NO_ROW`.

    Rows are searched in ``out/rows`` and ``results/rows``. A run is equal if it has the same task, version
    and seed, and the same value of each setting that both rows have.

    Raises
    ------
    InputError
        When a measure differs.
    """
    files = []
    for file, other in _rows():
        if not _is_of_run(row, other):
            continue
        for name in COMPARED:
            now, before = row.get(name), other.get(name)
            if now is None or before is None:
                continue
            if abs(now - before) > max(RELATIVE * abs(before), ABSOLUTE):
                raise InputError(
                    f"{row['method.name']} on {row['task.name']}: {name} is {now:.4g} where it is timed, and "
                    f"{before:.4g} in {file}: the rows are of other code; run them again"
                )
        files.append(file)
    return ", ".join(dict.fromkeys(files)) or NO_ROW


def _is_of_run(row: Row, other: Row) -> bool:
    settings = [name for name in row if name.startswith("method.") and name not in NAMES]
    both = [name for name in settings if None not in (row[name], other.get(name))]
    return all(row[name] == other.get(name) for name in (*RUN, *both))


@cache
def _rows() -> list[tuple[str, dict[str, Any]]]:
    """Return the rows with a result, with their files."""
    paths = [path for folder in (ROWS, PUBLISHED / ROWS.name) for path in sorted(folder.glob("*.csv"))]
    return [(path.as_posix(), row) for path in paths for row in records(valid(read_csv(path)))]
