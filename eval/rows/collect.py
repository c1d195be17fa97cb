"""Gather the rows of runs: ``sshade-eval collect [EXPERIMENT ...]`` writes one CSV an experiment.

Folders of the same name, such as ``alice/runs/quick`` and ``bob/runs/quick``,
are one experiment: their rows go into one CSV. Of equal runs the latest one is
kept; runs of different machines are kept apart.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from eval.rows.frame import newest, to_frame, write_csv
from eval.rows.store import FOLDER_HELP, ROWS, RUNS, experiment_folder, read_row, run_folders
from sshade.errors import InputError


def collect(*folders: Path) -> pd.DataFrame:
    """The rows under folders of runs: the newest of each method, task, seed and machine, in a fixed order.

    Raises
    ------
    InputError
        When there are none.
    """
    rows = to_frame(read_row(run) for folder in folders for run in run_folders(folder))
    if rows.empty:
        raise InputError(
            f"{folders[0]}: no runs there; `sshade-eval run -m experiment={folders[0].name}` makes them"
        )
    return newest(rows)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    parser.add_argument("-o", "--out", type=Path, default=ROWS, help="default: %(default)s")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    folders = [experiment_folder(folder) for folder in options.folders]
    # A refused run leaves an empty folder behind.
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
        machines = rows["env.machine"].nunique()
        counts = f"{len(rows)} row{'s' * (len(rows) > 1)}"
        print(f"{path}: {counts}" + (f" of {machines} machines" if machines > 1 else ""))  # noqa: T201
    return 0
