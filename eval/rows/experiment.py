"""An experiment's rows, and where the runs behind them lie."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.publish.summary import method_names
from eval.rows.store import (
    ROWS,
    RUNS,
    VALID,
    Row,
    read_csv,
    read_curves,
    read_row,
    read_vertices,
    rows_file,
    run_folder,
)
from sshade.errors import InputError


@dataclass(frozen=True)
class Experiment:
    """Rows that make one table.

    Parameters
    ----------
    name : str
    rows : list of rows
    runs : tuple of path
        Folders that may hold their run folders.
    """

    name: str
    rows: list[Row]
    runs: tuple[Path, ...]

    @property
    def methods(self) -> list[str]:
        """Methods in the order of the table."""
        return method_names(self.rows)

    @property
    def valid(self) -> list[Row]:
        """Rows with a result."""
        return [row for row in self.rows if row["status"] in VALID]

    def cases(self) -> list[list[Row]]:
        """Valid rows by case, each in the order of methods; of several seeds the first one.

        A case is told by its name and its checksum: one name can stand for several resolutions.
        """
        place = {method: i for i, method in enumerate(self.methods)}
        found: dict[tuple[str, float, str], dict[str, Row]] = {}
        for row in sorted(self.valid, key=lambda row: (place[row["method.name"]], row["seed"])):
            case = row["task.name"], row["task.vertices"], row["task.checksum"]
            found.setdefault(case, {}).setdefault(row["method.name"], row)
        return [list(found[case].values()) for case in sorted(found)]

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
