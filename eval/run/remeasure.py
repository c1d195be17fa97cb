"""Measure finished runs again from their stored vertices: ``sshade-eval remeasure EXPERIMENT ...``.

After a metric was added or changed, this command measures all rows with another version of the metrics. It
runs no method. The stored vertices have single precision, so a new value has a relative error of about
1e-5. The column ``remeasured`` holds the time of the new measurement.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

from eval.rows.files import FOLDER_HELP, experiment_folder
from eval.rows.store import VALID, read_row, run_folders, version_of, write_row
from eval.run.code import METRICS, require_unchanged
from eval.run.recall import measured_again
from sshade.core.console import progress_bar
from sshade.core.progress import Progress, silent


def remeasure(folder: Path, *, progress: Progress = silent) -> int:
    """Measure all runs in a folder whose row has another version of the metrics.

    Returns
    -------
    int
        Number of changed rows.

    Raises
    ------
    InputError
        When the dataset of a run has changed, its vertices are missing, or the code of the metrics changes
        during the command.
    """
    runs = [(read_row(run), run) for run in run_folders(folder)]
    runs = [(row, run) for row, run in runs if row["status"] in VALID and version_of(row)[1] != METRICS]
    for row, run, values in measured_again(runs, stage=folder.name, progress=progress):
        require_unchanged(())
        kept = {name: value for name, value in row.items() if not name.startswith("metric.")}
        kept |= {f"metric.{name}": value for name, value in values.items()}
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        write_row(run, kept | {"env.version.metrics": METRICS, "remeasured": now})
    return len(runs)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="+", type=Path, help=FOLDER_HELP)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    for folder in [experiment_folder(name) for name in options.folders]:
        with progress_bar() as progress:
            changed = remeasure(folder, progress=progress)
        print(f"{folder}: {changed} of {len(run_folders(folder))} rows changed")  # noqa: T201
    return 0
