"""Gather the rows of runs: ``python -m eval.collect [RUNS/EXPERIMENT ...]`` writes one CSV an experiment."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from eval.store import Row, newest, read_row, run_folders, write_csv
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
    parser.add_argument("folders", nargs="*", type=Path, help="default: every folder in results/runs")
    parser.add_argument("-o", "--out", type=Path, default=Path("results/rows"))
    options = parser.parse_args(arguments)
    folders = options.folders or sorted(path for path in Path("results/runs").glob("*") if path.is_dir())
    if not folders:
        raise InputError("results/runs holds no experiment; name the folders of runs to collect")
    for folder in folders:
        rows = collect(folder)
        path = options.out / f"{folder.name}.csv"
        write_csv(path, rows)
        print(f"{path}: {len(rows)} rows")  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(run_command(main))
