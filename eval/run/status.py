"""How far sweeps are, from any terminal: ``sshade-eval status [EXPERIMENT ...]``.

Reads what the runs of a sweep leave on disk, by whichever launcher and on
whichever machine they run. A sweep that ended is listed no more; one that was
killed, and so could not take its record away, is listed until ``--forget``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.rows.store import FOLDER_HELP, RUNS
from eval.run.record import SweepRecord, counts, records
from sshade.errors import InputError


def report(record: SweepRecord) -> str:
    """A sweep in one line."""
    plan, ended = record.plan(), record.ended()
    begin = plan.begin.astimezone()
    text = f"{record.folder.parents[1].name}: {counts(plan, ended)}"
    text += f" (launcher {plan.launcher}, begun {begin:%Y-%m-%d %H:%M} on {plan.host}"
    if ended:
        text += f", last run ended {ended[-1].end.astimezone():%H:%M:%S}"
    return f"{text})"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folders", nargs="*", type=Path, help=f"{FOLDER_HELP} (default: all)")
    parser.add_argument("--forget", action="store_true", help="remove the records; the rows stay")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    folders = [name if name.is_dir() else RUNS / name for name in options.folders] or sorted(RUNS.glob("*"))
    missing = [folder for folder in folders if not folder.is_dir()]
    if missing:
        raise InputError(f"there is no folder {missing[0]}; `sshade-eval run -m experiment=...` makes it")
    found = [record for folder in folders for record in records(folder)]
    for record in found:
        print(report(record))  # noqa: T201
        if options.forget:
            record.remove()
    if not found:
        print("no sweep is under way")  # noqa: T201
    return 0
