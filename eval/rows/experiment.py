"""An experiment: its rows, found by name, and the runs behind them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from eval.rows.collect import collect
from eval.rows.frame import method_names, read_csv, records, valid
from eval.rows.store import (
    PUBLISHED,
    ROWS,
    RUNS,
    Row,
    experiment_folder,
    read_curves,
    read_row,
    read_vertices,
    run_folder,
)
from sshade.errors import InputError


@dataclass(frozen=True)
class Experiment:
    """Rows that make one table.

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
        """Methods in the order of the table."""
        return method_names(self.rows)

    def cases(self) -> Iterator[list[Row]]:
        """Valid rows by case, each in the order of methods; of several seeds the first one.

        The name and the checksum identify a case: one name can stand for several resolutions.
        """
        rows = valid(self.rows).assign(place=lambda rows: rows["method.name"].map(self.methods.index))
        case = ["task.name", "task.vertices", "task.checksum"]
        rows = rows.sort_values(["place", "seed"]).drop_duplicates([*case, "method.name"])
        for _, group in rows.groupby(case):
            yield records(group.drop(columns="place"))

    def folder(self, row: Row) -> Path | None:
        """The run folder of a row, or None where it is not here."""
        for root in self.runs:
            folder = run_folder(root, row)
            stored = read_row(folder)
            # Equal runs of several machines, or run again, have one folder name.
            if stored is not None and stored["key"] == row["key"] and stored["date"] == row["date"]:
                return folder
        return None

    def vertices(self, row: Row) -> np.ndarray | None:
        """(n, 3) float64: what a run left, or None where that is not here."""
        folder = self.folder(row)
        return None if folder is None else read_vertices(folder, n=row["task.vertices"])

    def curves(self, row: Row) -> dict[str, np.ndarray]:
        """The arrays of a line a step that a run left; none where the run is not here."""
        folder = self.folder(row)
        return {} if folder is None else read_curves(folder)


def read_experiments(
    names: Sequence[str | os.PathLike[str]], *, runs: Sequence[Path] = ()
) -> list[Experiment]:
    """Read rows, given by a CSV or by the name of an experiment; none: every CSV in out/rows.

    Parameters
    ----------
    names : sequence of path
    runs : sequence of path
        Folders of run folders; none: out/runs/<experiment>.

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


def rows_file(name: str | os.PathLike[str]) -> Path:
    """The CSV meant by a path, or by the name of an experiment: in out/rows, or else in results/rows."""
    if Path(name).suffix == ".csv":
        return Path(name)
    files = [folder / f"{name}.csv" for folder in (ROWS, PUBLISHED / "rows")]
    return next((path for path in files if path.is_file()), files[0])


def load_rows(name: str | os.PathLike[str]) -> pd.DataFrame:
    """Rows of a CSV, of a folder of runs, or of an experiment by its name."""
    path = rows_file(name)
    if Path(name).suffix == ".csv" or (path.is_file() and not Path(name).is_dir()):
        return read_csv(path)
    return collect(experiment_folder(Path(name)))
