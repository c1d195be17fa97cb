"""Gather the rows of runs: ``python -m eval.collect [EXPERIMENT ...]`` writes one CSV an experiment."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from eval.store import FOLDER_HELP, RUNS, Row, experiment_folder, newest, read_row, run_folders, write_csv
from sshade.console import run_command
from sshade.errors import InputError


def collect(folder: Path) -> list[Row]:
    """The rows under a folder of runs: the newest of each method, task and seed, in a fixed order.

    Raises
    ------
    InputError
        When there are none.
    """
    rows = newest(read_row(run) for run in run_folders(folder))
    if not rows:
        raise InputError(f"{folder}: no runs there; `python -m eval -m experiment={folder.name}` makes them")
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python -m eval.collect``."""
    parser = argparse.ArgumentParser(prog="python -m eval.collect", description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    parser.add_argument("-o", "--out", type=Path, default=Path("results/rows"))
    options = parser.parse_args(arguments)
    folders = [experiment_folder(folder) for folder in options.folders]
    folders = folders or sorted(path for path in RUNS.glob("*") if path.is_dir())
    if not folders:
        raise InputError(f"{RUNS} holds no experiment; name the folders of runs to collect")
    for folder in folders:
        rows = collect(folder)
        path = options.out / f"{folder.name}.csv"
        write_csv(path, rows)
        print(f"{path}: {len(rows)} rows")  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(run_command(main))
