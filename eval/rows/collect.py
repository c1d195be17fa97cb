"""Collect the rows of runs: ``sshade-eval collect [EXPERIMENT ...]`` writes one CSV per experiment.

Folders with the same name, such as ``alice/runs/quick`` and ``bob/runs/quick``, are one experiment and share
a CSV. Only the latest of several equal runs is kept. A damaged row is left out, with a note.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from eval.rows.files import FOLDER_HELP, ROWS, RUNS, add_out, experiment_folder, rows_file
from eval.rows.frame import method_names, newest, of_methods, read_csv, records, to_frame, valid, write_csv
from eval.rows.store import DamagedRun, Row, read_row, require_vertices, run_folder, run_folders
from sshade.core.console import say
from sshade.core.errors import InputError


def collect(*folders: Path) -> pd.DataFrame:
    """Return the newest row of each method, task and seed in folders of runs, in a fixed order.

    Raises
    ------
    InputError
        When the folders hold no rows.
    """
    rows = [row for folder in folders for run in run_folders(folder) if (row := _read(run)) is not None]
    if not rows:
        again = f"`sshade-eval run -m experiment={folders[0].name}` makes them"
        raise InputError(f"{folders[0]}: no runs there; {again}")
    return newest(to_frame(rows))


def _read(run: Path) -> Row | None:
    """Read the row of a run; say where it is damaged."""
    try:
        return read_row(run)
    except DamagedRun as error:
        say(f"note: {error}; it is left out until the run is done again")
        return None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    add_out(parser, ROWS, "folder of the rows")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    folders = [experiment_folder(folder) for folder in options.folders]
    # A run with a mistake in its configuration leaves an empty folder.
    folders = folders or sorted(path for path in RUNS.glob("*") if run_folders(path))
    if not folders:
        raise InputError(f"{RUNS} holds no experiment; name the folders of runs to collect")
    experiments: dict[str, list[Path]] = {}
    for folder in folders:
        experiments.setdefault(folder.resolve().name, []).append(folder)
    for name, parts in experiments.items():
        rows = collect(*parts)
        path = options.out / f"{name}.csv"
        write_csv(path, rows)
        print(f"{path}: {len(rows)} row{'s' * (len(rows) > 1)}")  # noqa: T201
    return 0


class Experiment(NamedTuple):
    """The rows of one table.

    Parameters
    ----------
    name : str
    rows : DataFrame
    runs : path
        Folder that may hold their run folders.
    """

    name: str
    rows: pd.DataFrame
    runs: Path

    @property
    def methods(self) -> list[str]:
        """Return the methods in the order of the table."""
        return method_names(of_methods(self.rows))

    def cases(self, names: Sequence[str] = ()) -> Iterator[list[Row]]:
        """Yield the valid rows of each case, or of the named ones; methods in order, with their first seed.

        Name and checksum identify a case, because cases with different resolutions can share a name.
        """
        rows = valid(of_methods(self.rows)).assign(
            place=lambda rows: rows["method.name"].map(self.methods.index)
        )
        case = ["task.name", "task.vertices", "task.checksum"]
        rows = rows.sort_values(["place", "seed"]).drop_duplicates([*case, "method.name"])
        for (name, *_), group in rows.groupby(case):
            if not names or name in names:
                yield records(group.drop(columns="place"))

    def vertices(self, row: Row) -> np.ndarray | None:
        """Return the deformed vertices (n, 3) of a row, or None if its run folder is not on this machine."""
        folder = run_folder(self.runs, row)
        stored = read_row(folder)
        # Equal runs on several machines, and repeated runs, share a folder name.
        if stored is None or (stored["key"], stored["date"]) != (row["key"], row["date"]):
            return None
        return require_vertices(folder, n=row["task.vertices"]).astype(np.float64)


def read_experiments(names: Sequence[str | os.PathLike[str]]) -> list[Experiment]:
    """Read the rows of experiments, whose run folders are in out/runs/<experiment>.

    Parameters
    ----------
    names : sequence of path
        CSV files or names of experiments; if empty, every CSV in out/rows.

    Raises
    ------
    InputError
        When there are no rows, or two experiments have the same name.
    """
    paths = [rows_file(name) for name in names] or sorted(ROWS.glob("*.csv"))
    if not paths:
        raise InputError(f"{ROWS} holds no rows; `sshade-eval collect` makes them from runs")
    stems = [path.stem for path in paths]
    repeated = [stem for stem in stems if stems.count(stem) > 1]
    if repeated:
        raise InputError(f"two experiments are named {repeated[0]!r}; give them one CSV, or other names")
    return [Experiment(path.stem, read_csv(path), RUNS / path.stem) for path in paths]
