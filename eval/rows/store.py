"""The store of runs: one folder per run with ``row.json`` and the deformed vertices.

A row maps the columns ``task.* method.* seed status reason iterations converged metric.* seconds.* peak_mib
env.* measures key`` to numbers, strings, bools or None.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from eval.rows.files import make_folder
from sshade.core.errors import InputError
from sshade.core.whole_files import replacing

Row = dict[str, Any]

#: Values of the column ``status``. The first two are valid results.
STATUSES = ("ok", "not_converged", "timeout", "failed", "skipped")
VALID = ("ok", "not_converged")
#: Value of ``task.kind`` for pose transfers; rows of deformations by handles have no ``task.kind``.
TRANSFER = "transfer"
#: Value of ``method.name`` in the row of a true pose, which is measured like a result and is no method.
TRUE_POSE = "true pose"

#: Infinities by their text in ``row.json``.
_INFINITIES = {str(value): value for value in (math.inf, -math.inf)}

#: Columns of every row.
IDENTITY = ("task.name", "method.name", "status", "seed", "method.hash", "key", "date", "env.machine")
#: Columns and groups of columns that hold text, even if it looks like a number: a label 5, a version 1.0.
_TEXT = (
    *(name for name in IDENTITY if name != "seed"),
    *("reason", "task.checksum", "task.source", "method.note"),
    *("env.machine_id", "env.commit", "env.python"),
    *(f"env.{library}_num_threads" for library in ("omp", "openblas", "mkl")),
    *(f"task.meta.{fact}" for fact in ("checksum", "class", "dataset", "edit", "note", "posed_by")),
    *("task.meta.source_pose", "env.version."),
)

_GROUPS = (
    *("task.", "method.", "seed", "status", "reason", "iterations", "converged"),
    *("metric.", "extra.", "seconds.", "peak_mib", "env.", "date", "schema", "measures", "key"),
)


class DamagedRun(InputError):
    """A file of a run is damaged; the run must be done again."""


def run_folder(root: str | os.PathLike[str], row: Row) -> Path:
    """Return ``root/<method>/<task>/seed_<seed>_<key>``, with names that every file system accepts."""
    safe = [re.sub(r"[^\w.+=-]+", "_", str(row[name])) for name in ("method.name", "task.name")]
    return Path(root, *safe, f"seed_{row['seed']}_{row['key'][:12]}")


def write_run(
    folder: str | os.PathLike[str],
    row: Row,
    *,
    vertices: np.ndarray | None = None,
) -> None:
    """Write a run. The row is written last, so a folder with a row is complete.

    Parameters
    ----------
    folder : path
        Created if missing.
    row : mapping
    vertices : (n, 3) float64, optional
        Stored as float32, which is enough to measure a metric again to about 1e-7.
    """
    folder = Path(folder)
    make_folder(folder)
    if vertices is None:
        (folder / "vertices.npy").unlink(missing_ok=True)
    else:
        with replacing(folder / "vertices.npy") as temporary:
            np.save(temporary, np.asarray(vertices, dtype=np.float32))
    write_row(folder, row)


def write_row(folder: str | os.PathLike[str], row: Row) -> None:
    """Write the row of a run folder; the other files stay."""
    with replacing(Path(folder, "row.json")) as temporary:
        cells = {name: row[name] for name in in_order(row)}
        # JSON has no infinity, but parameters of methods can be infinite.
        cells |= {name: str(value) for name, value in row.items() if value in _INFINITIES.values()}
        cells = {printable(name): value for name, value in cells.items()}
        temporary.write_text(json.dumps(cells, indent=1, allow_nan=False) + "\n")


def read_row(folder: str | os.PathLike[str]) -> Row | None:
    """Read the row of a run folder; None if the run is not complete."""
    path = Path(folder, "row.json")
    if not path.is_file():
        return None
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise DamagedRun(f"{path}: not a row ({error})") from error
    if problem := row_problem(row):
        raise DamagedRun(f"{path}: not a row ({problem})")
    return {n: plain(value if is_text(n) else _INFINITIES.get(value, value)) for n, value in row.items()}


def is_scalar(value: Any) -> bool:
    """Whether a value fits into a cell of a row; an integer of more than 64 bits does not."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, int) and value.bit_length() > 64:
        return False
    return value is None or isinstance(value, (bool, int, float, str))


def plain(value: Any) -> Any:
    """Return a scalar as a value that every file of rows can hold: a Python type, None for NaN."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, str):
        return printable(value)
    return None if isinstance(value, float) and math.isnan(value) else value


def printable(text: str) -> str:
    """Return a text with its lone surrogates, such as parts of names that are not UTF-8, as ``\\udc80``."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def row_problem(row: Any) -> str:
    """Describe why a value is not a row; empty if it is."""
    if not isinstance(row, dict):
        return "no object"
    missing = [name for name in IDENTITY if row.get(name) is None]
    if missing:
        return f"it has no {missing[0]}"
    if row["status"] not in STATUSES:
        return f"its status is {row['status']!r}"
    named = (name for name in row if name.startswith(("metric.", "seconds.")) or name == "iterations")
    text = next((name for name in named if isinstance(row[name], str)), None)
    return f"its {text} is {row[text]!r}" if text else ""


def require_vertices(folder: str | os.PathLike[str], *, n: int) -> np.ndarray:
    """Return the deformed vertices (n, 3) of a run folder as they are stored; they are read when used.

    Raises
    ------
    DamagedRun
        When the file is missing, damaged, or has another shape.
    """
    path = Path(folder, "vertices.npy")
    if not path.is_file():
        raise DamagedRun(f"{path}: no such file; the run left no vertices")
    try:
        V = np.load(path, allow_pickle=False, mmap_mode="r")
    except Exception as error:  # numpy raises many types of errors for damaged files
        why = " ".join(str(error).split())
        raise DamagedRun(f"{path}: not the file of a run ({why})") from error
    if V.shape != (n, 3):
        raise DamagedRun(f"{path}: has shape {V.shape}, not ({n}, 3)")
    return V


def run_folders(root: str | os.PathLike[str]) -> list[Path]:
    """Return the folders below `root` that hold a row, sorted."""
    return sorted(path.parent for path in Path(root).rglob("row.json"))


def in_order(columns: Iterable[str]) -> list[str]:
    """Sort the names of columns by group, then alphabetically."""

    def place(name: str) -> tuple[int, str]:
        group = next((i for i, group in enumerate(_GROUPS) if in_group(name, group)), len(_GROUPS))
        return group, name

    return sorted(columns, key=place)


def is_text(name: str) -> bool:
    """Whether a column holds text, even if a value looks like a number."""
    return any(in_group(name, group) for group in _TEXT)


def in_group(name: str, group: str) -> bool:
    """Whether a column has the name `group`, or belongs to a group such as ``metric.``."""
    return name == group or (group.endswith(".") and name.startswith(group))
