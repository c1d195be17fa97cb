"""The store of runs: one folder a run with ``row.json`` and the deformed vertices; rows as CSV.

A row is a flat mapping from ``task.* method.* seed status reason iterations
converged metric.* seconds.* peak_mib env.* schema key`` to a number, a string, a
bool or None.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.io.files import make_folder, replacing

Row = dict[str, Any]

#: Raised when the meaning of a column changes; part of every key.
SCHEMA = 1

#: Where the runs lie by default: one folder an experiment.
RUNS = Path("out/runs")
#: Where their rows are collected: one CSV an experiment.
ROWS = Path("out/rows")
FOLDER_HELP = "name of an experiment in out/runs, or a folder of runs"
ROWS_HELP = "CSV made by `sshade-eval collect`, or name of an experiment in out/rows"

#: What became of a run. The first two are valid results.
STATUSES = ("ok", "not_converged", "timeout", "failed", "skipped")
VALID = ("ok", "not_converged")

#: ``task.kind`` of rows of pose transfers; those of deformations by handles have none.
TRANSFER = "transfer"

#: What every row has.
IDENTITY = ("task.name", "method.name", "method.hash", "seed", "status", "key", "date", "env.machine")
#: Beginnings of columns that hold numbers, or nothing.
_NUMBERS = ("metric.", "seconds.", "iterations", "task.vertices", "peak_mib")

_GROUPS = ("task.", "method.", "seed", "status", "reason", "iterations", "converged")
_LATER_GROUPS = ("metric.", "extra.", "seconds.", "peak_mib", "env.", "date", "schema", "key")
_TEXT_COLUMNS = (
    "reason",
    "key",
    "task.checksum",
    "task.source",
    "method.hash",
    "method.sources",
    "method.note",
    "env.commit",
    "env.omp_num_threads",
    "env.openblas_num_threads",
    "env.mkl_num_threads",
)


def run_folder(root: str | os.PathLike[str], row: Row) -> Path:
    """``root/<method>/<task>/seed_<seed>_<key>``, with names made safe for any file system."""
    safe = [re.sub(r"[^\w.+=-]+", "_", str(row[name])) for name in ("method.name", "task.name")]
    return Path(root, *safe, f"seed_{row['seed']}_{row['key'][:12]}")


def experiment_folder(name: Path) -> Path:
    """A folder of runs, given as such or by the name of its experiment.

    Raises
    ------
    InputError
        When there is neither.
    """
    for folder in (name, RUNS / name):
        # A folder such as "quick" beside the command may be anything; one with runs is meant.
        if folder.is_dir() and next(folder.rglob("row.json"), None) is not None:
            return folder
    raise InputError(f"no runs in {name} or {RUNS / name}; `sshade-eval run -m experiment=...` makes them")


def write_run(
    folder: str | os.PathLike[str],
    row: Row,
    *,
    vertices: np.ndarray | None = None,
    curves: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write a run: the row last, so that a folder with a row is complete.

    Parameters
    ----------
    folder : path
        Made if missing.
    row : mapping
    vertices : (n, 3) float64, optional
        Stored as float32: enough to recompute a metric to about 1e-7.
    curves : mapping, optional
        Arrays of a line a step, such as losses, by name.
    """
    folder = Path(folder)
    make_folder(folder)
    if curves:
        with replacing(folder / "curves.npz") as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **curves)
    else:
        (folder / "curves.npz").unlink(missing_ok=True)
    if vertices is None:
        (folder / "vertices.npy").unlink(missing_ok=True)
    else:
        with replacing(folder / "vertices.npy") as temporary:
            np.save(temporary, np.asarray(vertices, dtype=np.float32))
    write_row(folder, row)


def write_row(folder: str | os.PathLike[str], row: Row) -> None:
    """Write the row of a run folder, or replace it; the rest of the folder stays."""
    with replacing(Path(folder, "row.json")) as temporary:
        temporary.write_text(json.dumps(ordered(row), indent=1) + "\n")


def read_row(folder: str | os.PathLike[str]) -> Row | None:
    """The row of a run folder, or None where none was completed."""
    path = Path(folder, "row.json")
    if not path.is_file():
        return None
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a row ({error}); remove the folder to run it again") from error
    problem = _problem(row)
    if problem:
        raise InputError(f"{path}: not a row ({problem}); remove the folder to run it again")
    return row


def _problem(row: Any) -> str:
    """What keeps a row from being used, or nothing."""
    if not isinstance(row, dict):
        return "no object"
    missing = [name for name in IDENTITY if row.get(name) is None]
    if missing:
        return f"it has no {missing[0]}"
    if row["status"] not in STATUSES:
        return f"its status is {row['status']!r}"
    for name, value in row.items():
        if isinstance(value, (list, dict)):
            return f"{name} is no plain value"
        if name.startswith(_NUMBERS) and not (value is None or type(value) in (int, float)):
            return f"{name} is {value!r}, no number"
    return ""


def read_vertices(folder: str | os.PathLike[str], *, n: int) -> np.ndarray:
    """(n, 3) float64: the deformed vertices of a run folder, whose row says how many there are.

    Raises
    ------
    InputError
        When the file is missing, damaged, or of another shape.
    """
    path = Path(folder, "vertices.npy")
    if not path.is_file():
        raise InputError(f"{path}: no such file; the run left no vertices")
    V = _loading(path, lambda: np.load(path, allow_pickle=False).astype(np.float64))
    if V.shape != (n, 3):
        raise InputError(f"{path}: has shape {V.shape}, not ({n}, 3); remove the folder to run it again")
    return V


def read_curves(folder: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of a line a step that a run left, by name; none is fine."""
    path = Path(folder, "curves.npz")
    if not path.is_file():
        return {}

    def read() -> dict[str, np.ndarray]:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}

    return _loading(path, read)


def _loading(path: Path, read: Callable[[], Any]) -> Any:
    try:
        return read()
    except Exception as error:  # zipfile and numpy fail in many ways, all of them the file's fault
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: not the file of a run ({reason}); remove the folder to run it again"
        ) from error


def run_folders(root: str | os.PathLike[str]) -> list[Path]:
    """Folders under `root` that hold a row, sorted."""
    return sorted(path.parent for path in Path(root).rglob("row.json"))


def newest(rows: Iterable[Row], *, across_machines: bool = False) -> list[Row]:
    """One row for each (method, its parameters, task, seed, machine): the latest one, in a fixed order.

    Two rows have the same task if it has the same name and either the same
    checksum (so that copies of a dataset in different folders are one), or the
    same source (so that after a rebuild of a dataset the old rows give way).

    Parameters
    ----------
    rows : iterable of rows
    across_machines : bool
        Keep the latest one of all machines, for numbers that do not depend on the machine.
    """
    rows = list(rows)
    for told_by in ("task.checksum", "task.source"):
        kept: dict[tuple, Row] = {}
        for row in sorted(rows, key=lambda row: (row["date"], row["key"])):
            task = row["task.name"], row.get(told_by) or ""
            machine = "" if across_machines else row["env.machine"]
            kept[row["method.name"], row["method.hash"], *task, row["seed"], machine] = row
        rows = [kept[identity] for identity in sorted(kept)]
    return rows


def ordered(row: Mapping[str, Any]) -> Row:
    """The same row with its columns in the fixed order."""
    return {name: row[name] for name in columns([row])}


def columns(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Every column of the rows: group by group, alphabetical within a group."""
    groups = (*_GROUPS, *_LATER_GROUPS)

    def place(name: str) -> tuple[int, str]:
        for i, group in enumerate(groups):
            if name == group or (group.endswith(".") and name.startswith(group)):
                return i, name
        return len(groups), name

    return sorted({name for row in rows for name in row}, key=place)


def write_csv(path: str | os.PathLike[str], rows: list[Row]) -> None:
    """Write rows as CSV; the same rows give the same bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = columns(rows)
    writer.writerow(names)
    writer.writerows([[_cell(row.get(name)) for name in names] for row in rows])
    path = Path(path)
    make_folder(path.parent)
    with replacing(path) as temporary:
        temporary.write_text(text.getvalue())


def rows_file(name: str | os.PathLike[str]) -> Path:
    """The CSV of rows that is meant by a path, or by the name of an experiment."""
    path = Path(name)
    return path if path.suffix == ".csv" else ROWS / f"{name}.csv"


def read_csv(path: str | os.PathLike[str]) -> list[Row]:
    """Read rows back; an empty cell is None.

    Raises
    ------
    InputError
        When the file is missing or holds no rows.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; `sshade-eval collect` makes it from runs")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.DictReader(file))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable CSV file ({error})") from error
    if not lines or "status" not in lines[0]:
        raise InputError(f"{path}: holds no rows of runs")
    rows = []
    for number, line in enumerate(lines, start=2):
        if None in line or None in line.values():
            raise InputError(
                f"{path}: line {number} has another number of cells than the first; collect again"
            )
        rows.append({name: _value(name, cell) for name, cell in line.items()})
        problem = _problem(rows[-1])
        if problem:
            raise InputError(f"{path}: line {number} is not a row ({problem}); collect again")
    return rows


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _value(name: str, cell: str) -> Any:
    if cell == "":
        return None
    # A hash such as 12e4567890123456 is no number, nor is a variable of the environment.
    if name in _TEXT_COLUMNS or name.startswith("env.version."):
        return cell
    if cell in ("true", "false"):
        return cell == "true"
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell
