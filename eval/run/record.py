"""The record of a sweep, in files, so that any process on any machine can read its progress.

The record is a folder ``<runs>/<experiment>/.sweeps/<id>``. The file ``sweep.json`` lists the runs, and each
finished run adds a file. No two processes write the same file. The record is removed at the end of the sweep;
the plan (:mod:`eval.rows.plan`) stays.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from eval.rows.files import write_text
from eval.rows.store import Row
from sshade.core.errors import InputError
from sshade.files.atomic import replacing

#: Folder with the records of sweeps, in the folder of the experiment.
RECORDS = ".sweeps"

#: Launchers whose runs continue after the process that began the sweep.
QUEUES = ("slurm", "submitit_slurm")

#: Columns of a row that the record keeps.
RECORDED = ("method.name", "task.name", "seed", "status", "reason", "iterations")
RECORDED += ("seconds.total", "seconds.startup")


@dataclass(frozen=True)
class Sweep:
    """A sweep that was begun.

    Parameters
    ----------
    begin : datetime
    runs : sequence of mappings
        Settings of each run, in the order of the sweeper.
    launcher : str
        Name of the launcher.
    host : str
        Name of the machine on which the sweep began.
    code : mapping
        Hash of each file of the code, by place, from the process that began the sweep.
    """

    begin: datetime
    runs: Sequence[Mapping[str, str]]
    launcher: str = "basic"
    host: str = ""
    code: Mapping[str, str] = field(default_factory=dict)


class EndedRun(NamedTuple):
    """A finished run of a sweep.

    Parameters
    ----------
    number : int
        Position in the sweep, from 0.
    end : datetime
    row : mapping or None
        The columns :data:`RECORDED` of the row; None if the run ended without a row.
    found : str
        Where an earlier row was found; "" for a new row.
    problems : sequence of str
        Reasons why the run counts as failed; empty for a good run.
    """

    number: int
    end: datetime
    row: Row | None
    found: str = ""
    problems: Sequence[str] = ()


class SweepRecord:
    """The folder of a sweep.

    Parameters
    ----------
    folder : path
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._read: dict[str, EndedRun] = {}

    @classmethod
    def create(cls, experiment: Path, sweep: Sweep) -> SweepRecord:
        """Create the record of a sweep in the folder of its experiment; it replaces a killed sweep's."""
        for other in records(experiment):
            with suppress(FileNotFoundError):  # the other sweep has just ended
                if other.given_up() and other.sweep().runs == sweep.runs:
                    other.remove()
        record = cls(experiment / RECORDS / f"{sweep.begin:%Y%m%dT%H%M%S.%f}_{os.getpid()}")
        content = vars(sweep) | {"begin": sweep.begin.isoformat(), "code": dict(sweep.code)}
        content["host"] = sweep.host or socket.gethostname()
        write_text(record.folder / "sweep.json", json.dumps(content))
        return record

    def sweep(self) -> Sweep:
        """Read the sweep."""
        content = json.loads((self.folder / "sweep.json").read_text())
        return Sweep(**content | {"begin": datetime.fromisoformat(content["begin"])})

    def add(self, number: int, *, row: Row | None, found: str = "", problems: Sequence[str] = ()) -> None:
        """Add a finished run, unless the sweep was abandoned and its record removed."""
        recorded = row and {name: row.get(name) for name in RECORDED}
        end = datetime.now(UTC).isoformat()
        content = {"end": end, "row": recorded, "found": found, "problems": list(problems)}
        try:
            with replacing(self.folder / f"{number}.json") as temporary:
                temporary.write_text(json.dumps(content))
        except InputError:
            if self.folder.exists():
                raise

    def ended(self) -> list[EndedRun]:
        """Return the finished runs. Runs that are new since the last call come last, ordered by their end."""
        new = [self._ended(path) for path in self.folder.glob("[0-9]*.json") if path.name not in self._read]
        for run in sorted(new, key=lambda run: (run.end, run.number)):
            self._read[f"{run.number}.json"] = run
        return list(self._read.values())

    @staticmethod
    def _ended(path: Path) -> EndedRun:
        content: dict[str, Any] = json.loads(path.read_text())
        return EndedRun(int(path.stem), **content | {"end": datetime.fromisoformat(content["end"])})

    def given_up(self) -> bool:
        """Whether the process of the sweep has ended early. False for sweeps on other machines."""
        sweep, pid = self.sweep(), int(self.folder.name.rpartition("_")[2])
        here = sweep.host == socket.gethostname() and sweep.launcher not in QUEUES
        return here and not psutil.pid_exists(pid)

    def remove(self) -> None:
        """Delete the record, but no rows."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def complete(self) -> None:
        """Delete the record, and older records of the same runs whose sweeps do not go on."""
        with suppress(FileNotFoundError):  # another sweep of the same runs has ended first
            runs = self.sweep().runs
            for other in records(self.folder.parents[1]):
                with suppress(FileNotFoundError):
                    sweep, older = other.sweep(), other.folder.name < self.folder.name
                    goes_on = sweep.host == socket.gethostname() and not other.given_up()
                    if older and sweep.runs == runs and not goes_on:
                        other.remove()
        self.remove()


def records(experiment: Path) -> list[SweepRecord]:
    """Return the records of running and unfinished sweeps of an experiment, the oldest first."""
    return [SweepRecord(path.parent) for path in sorted(experiment.glob(f"{RECORDS}/*/sweep.json"))]


def unfinished(experiment: Path) -> list[Sweep]:
    """Return the sweeps of an experiment that may still be running."""
    found = []
    for record in records(experiment):
        with suppress(FileNotFoundError):  # the sweep has just ended
            if not record.given_up():
                found.append(record.sweep())
    return found


def counts(sweep: Sweep, ended: Sequence[EndedRun]) -> str:
    """Describe the progress of a sweep: "3 done, 1 failed, 5 remaining"."""
    failed = sum(1 for run in ended if run.problems)
    return f"{len(ended)} done, {failed} failed, {len(sweep.runs) - len(ended)} remaining"


def run_line(run: EndedRun) -> str:
    """Describe a finished run in one line."""
    row = run.row
    if row is None:
        return f"run {run.number}: {'; '.join(run.problems)}"
    text = f"{row['method.name']} {row['task.name']} seed {row['seed']}: {status_text(row, found=run.found)}"
    # The status of a failed run already includes the reason.
    return f"{text} - {'; '.join(run.problems)}" if run.problems and row.get("seconds.total") else text


def status_text(row: Mapping[str, Any], *, found: str) -> str:
    """Describe the result of a run: "ok, 1.23 s, 40 iterations"."""
    if row.get("seconds.total") is None:
        return f"{row['status']} ({row['reason']})"
    startup = row.get("seconds.startup")
    text = f"{row['status']}, {row['seconds.total']:.2f} s"
    text += f" with a start-up of {startup:.2f} s" if startup is not None else ""
    text += f", {row['iterations']:g} iterations"
    return f"{text}, {found}" if found else text


def summary(sweep: Sweep, ended: Sequence[EndedRun]) -> str:
    """Describe a finished sweep: new rows by status, and rows that were found."""
    new = [run.row["status"] if run.row else "failed" for run in ended if not run.found]
    by_status = ", ".join(f"{new.count(status)} {status}" for status in sorted(set(new)))
    text = f"{len(sweep.runs)} runs: {len(new)} new{f' ({by_status})' if by_status else ''}"
    text += f", {len(ended) - len(new)} kept"
    missing = len(sweep.runs) - len(ended)
    return f"{text}, {missing} not done" if missing else text
