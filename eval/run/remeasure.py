"""Metrics of finished runs, from their vertices: ``sshade-eval remeasure EXPERIMENT ...``.

Adds to each row the metrics that it lacks, as after a new one was written; with
--metrics, computes those again. No method is run. The stored vertices are
single precision, so such a value differs a little (about 1e-5 of itself) from one
measured at the run; the row's column ``remeasured`` names the metrics that come from them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from eval.metrics import METRICS, measure
from eval.rows.store import (
    FOLDER_HELP,
    VALID,
    experiment_folder,
    read_row,
    read_vertices,
    run_folders,
    write_row,
)
from eval.run.recall import load_task
from sshade.cli.console import progress_bar
from sshade.errors import InputError
from sshade.task import Progress, silent


def remeasure(folder: Path, *, metrics: Sequence[str] = (), progress: Progress = silent) -> int:
    """Measure the runs under a folder; each row is replaced whole.

    Parameters
    ----------
    folder : path
    metrics : sequence of str
        Metrics to compute, whether or not a row has them; none: those that it lacks.
    progress : Progress

    Returns
    -------
    int
        How many rows changed.

    Raises
    ------
    InputError
        On an unknown metric, or when the dataset of a run is not the one that was run on.
    """
    unknown = [name for name in metrics if name not in METRICS]
    if unknown:
        raise InputError(f"there is no metric {unknown[0]!r}; there are {', '.join(METRICS)}")
    runs = [(read_row(run), run) for run in run_folders(folder)]
    runs = [(row, run) for row, run in runs if row["status"] in VALID]
    # The runs of a task follow each other, so that it is loaded once.
    runs.sort(key=lambda pair: (pair[0].get("task.source") or "", pair[0]["task.checksum"]))
    changed, loaded = 0, None
    for done, (row, run) in enumerate(runs):
        progress(folder.name, done, len(runs), row["task.name"])
        wanted = metrics or [name for name in METRICS if f"metric.{name}" not in row]
        if not wanted:
            continue
        if loaded is None or loaded[0] != row["task.checksum"]:
            loaded = row["task.checksum"], load_task(row)
        values = measure(loaded[1], read_vertices(run, n=row["task.vertices"]), only=wanted)
        if values:  # else nothing that this kind of task has
            names = {*(row.get("remeasured") or "").split(), *values}
            new = {f"metric.{name}": value for name, value in values.items()}
            write_row(run, row | new | {"remeasured": " ".join(sorted(names))})
            changed += 1
    return changed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="+", type=Path, help=FOLDER_HELP)
    parser.add_argument("--metrics", nargs="+", default=[], metavar="NAME", help="default: what a row lacks")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    for folder in [experiment_folder(name) for name in options.folders]:
        with progress_bar() as progress:
            changed = remeasure(folder, metrics=options.metrics, progress=progress)
        print(f"{folder}: {changed} of {len(run_folders(folder))} rows changed")  # noqa: T201
    return 0
