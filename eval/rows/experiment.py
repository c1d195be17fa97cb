"""Experiments: find rows by name, and the run folders of rows."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from eval.rows.collect import collect
from eval.rows.files import ROWS, RUNS, experiment_folder, rows_file
from eval.rows.frame import method_names, read_csv, records, valid
from eval.rows.store import Row, read_curves, read_row, read_vertices, run_folder
from sshade.core.errors import InputError


class Experiment(NamedTuple):
    """The rows of one table.

    Parameters
    ----------
    name : str
    rows : DataFrame
    runs : tuple of path
        Folders that may hold their run folders.
    """

    name: str
    rows: pd.DataFrame
    runs: tuple[Path, ...]

    @property
    def methods(self) -> list[str]:
        """Return the methods in the order of the table."""
        return method_names(self.rows)

    def cases(self) -> Iterator[list[Row]]:
        """Yield the valid rows of each case, in the order of methods; the first seed of each method.

        Name and checksum identify a case, because cases with different resolutions can share a name.
        """
        rows = valid(self.rows).assign(place=lambda rows: rows["method.name"].map(self.methods.index))
        case = ["task.name", "task.vertices", "task.checksum"]
        rows = rows.sort_values(["place", "seed"]).drop_duplicates([*case, "method.name"])
        for _, group in rows.groupby(case):
            yield records(group.drop(columns="place"))

    def folder(self, row: Row) -> Path | None:
        """Return the run folder of a row, or None if it is not on this machine."""
        for root in self.runs:
            folder = run_folder(root, row)
            stored = read_row(folder)
            # Equal runs on several machines, and repeated runs, share a folder name.
            if stored is not None and stored["key"] == row["key"] and stored["date"] == row["date"]:
                return folder
        return None

    def vertices(self, row: Row) -> np.ndarray | None:
        """Return the deformed vertices (n, 3) of a row, or None without its run folder."""
        folder = self.folder(row)
        return None if folder is None else read_vertices(folder, n=row["task.vertices"])

    def curves(self, row: Row) -> dict[str, np.ndarray]:
        """Return the stored curves of a row by name; empty without its run folder."""
        folder = self.folder(row)
        return {} if folder is None else read_curves(folder)


def read_experiments(
    names: Sequence[str | os.PathLike[str]], *, runs: Sequence[Path] = ()
) -> list[Experiment]:
    """Read the rows of experiments.

    Parameters
    ----------
    names : sequence of path
        CSV files or names of experiments; if empty, every CSV in out/rows.
    runs : sequence of path
        Folders of run folders; if empty, out/runs/<experiment>.

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
    return [Experiment(path.stem, read_csv(path), tuple(runs) or (RUNS / path.stem,)) for path in paths]


def load_rows(name: str | os.PathLike[str]) -> pd.DataFrame:
    """Read the rows of a CSV, a folder of runs, or an experiment by its name."""
    path = rows_file(name)
    if Path(name).suffix == ".csv" or (path.is_file() and not Path(name).is_dir()):
        return read_csv(path)
    return collect(experiment_folder(Path(name)))
