"""Show the progress of sweeps from any terminal: ``sshade-eval status [EXPERIMENT ...]``.

The command reads the records of sweeps, for all launchers and machines. A finished sweep has no record. A
killed sweep is listed until the same sweep is run to its end, or until ``--forget`` removes its record.
``--forget`` also removes the plans, so tables no longer count planned runs as missing.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.rows.files import FOLDER_HELP, RUNS, of_dataset
from eval.rows.plan import forget_plans
from eval.run.record import SweepRecord, counts, records
from sshade.core.errors import InputError


def report(record: SweepRecord) -> str:
    """Describe a sweep in one line."""
    sweep, ended = record.sweep(), record.ended()
    begin = sweep.begin.astimezone()
    text = f"{record.folder.parents[1].name}: {counts(sweep, ended)}"
    text += f" (launcher {sweep.launcher}, begun {begin:%Y-%m-%d %H:%M} on {sweep.host}"
    if ended:
        text += f", last run ended {ended[-1].end.astimezone():%H:%M:%S}"
    if record.given_up():
        text += "; its process is gone: the same command goes on from there, and with run.fresh=true each "
        text += "run has a process of its own, which a method may crash"
    return f"{text})"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    parser.add_argument("--forget", action="store_true", help="remove these records and plans; rows stay")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    folders = [name if name.is_dir() else of_dataset(RUNS / name) for name in options.folders] or sorted(
        RUNS.glob("*")
    )
    missing = [folder for folder in folders if not folder.is_dir()]
    if missing:
        raise InputError(f"there is no folder {missing[0]}; `sshade-eval run -m experiment=...` makes it")
    found = [record for folder in folders for record in records(folder)]
    for record in found:
        print(report(record))  # noqa: T201
        if options.forget:
            record.remove()
    for folder in folders if options.forget else ():
        forget_plans(folder)
    if not found:
        print("no sweep is under way")  # noqa: T201
    return 0
