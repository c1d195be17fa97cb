"""Collect the rows of runs: ``sshade-eval collect [EXPERIMENT ...]`` writes one CSV per experiment.

Folders with the same name, such as ``alice/runs/quick`` and ``bob/runs/quick``, are one experiment and share
a CSV. Only the latest of several equal runs is kept. A published row in ``results/rows`` is included if a
planned or finished run has the same version of the code and the metrics. A planned run without a row gets a
row with status ``missing``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from eval.rows.csv_rows import read_rows
from eval.rows.files import FOLDER_HELP, PUBLISHED, ROWS, RUNS, add_out, experiment_folder
from eval.rows.frame import newest, records, to_frame, write_csv
from eval.rows.plan import missing_rows, read_plans
from eval.rows.store import MISSING, Row, read_row, run_folders, version_of
from sshade.core.errors import InputError


def collect(*folders: Path) -> pd.DataFrame:
    """Return the newest row of each method, task and seed in folders of runs, in a fixed order.

    Raises
    ------
    InputError
        When the folders hold no rows.
    """
    rows = to_frame(read_row(run) for folder in folders for run in run_folders(folder))
    if rows.empty:
        name = folders[0].name
        again = f"`sshade-eval run -m experiment={name}` makes them"
        if read_plans(folders[0]):  # all rows of the sweep were published already
            again = (
                "results/rows already has the rows of all planned runs, without vertices; "
                f"`sshade-eval run -m experiment={name} run.experiment=my_{name}` makes runs of your own"
            )
        raise InputError(f"{folders[0]}: no runs there; {again}")
    return newest(rows, [run for folder in folders for run in read_plans(folder)])


def gather(name: str, folders: Sequence[Path]) -> pd.DataFrame:
    """Return the rows of an experiment: rows of its runs, published rows, and rows of missing runs.

    Raises
    ------
    InputError
        When the experiment has no rows.
    """
    planned = [run for folder in folders for run in read_plans(folder)]
    own = [read_row(run) for folder in folders for run in run_folders(folder)]
    versions = {version_of(row) for row in (*planned, *own) if version_of(row)[0]}
    path = PUBLISHED / "rows" / f"{name}.csv"
    published = read_rows(path) if path.is_file() else []
    joined = [row for row in published if version_of(row) in versions]
    if not own and not joined:
        raise InputError(f"{folders[0]}: no runs there; `sshade-eval run -m experiment={name}` makes them")
    planned += [row for row in published if joined and row["status"] == MISSING]
    return with_missing([*own, *joined], planned)


def with_missing(rows: Iterable[Row], planned: Iterable[Row]) -> pd.DataFrame:
    """Return the newest rows, and a row with status ``missing`` for each planned run without a row."""
    planned = list(planned)
    rows = records(newest(to_frame(rows), planned))
    return to_frame([*rows, *missing_rows(planned, rows)])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    add_out(parser, ROWS, "folder of the rows")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    folders = [experiment_folder(folder) for folder in options.folders]
    # A run with a mistake in its configuration leaves an empty folder.
    folders = folders or sorted(path for path in RUNS.glob("*") if run_folders(path) or read_plans(path))
    if not folders:
        raise InputError(f"{RUNS} holds no experiment; name the folders of runs to collect")
    experiments: dict[str, list[Path]] = {}
    for folder in folders:
        experiments.setdefault(folder.resolve().name, []).append(folder)
    for name, parts in experiments.items():
        rows = gather(name, parts)
        path = options.out / f"{name}.csv"
        write_csv(path, rows)
        missing = int(rows["status"].eq(MISSING).sum())
        done = len(rows) - missing
        text = f"{path}: {done} row{'s' * (done > 1)}"
        print(text + (f", {missing} of {len(rows)} planned runs missing" if missing else ""))  # noqa: T201
    return 0
