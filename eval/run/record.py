"""The record of a sweep, in files: any process, on any machine, can tell how far the sweep is.

The record is a folder ``<runs>/<experiment>/.sweeps/<id>`` with ``sweep.json``,
what there is to do, and one file for each run that ended, by whichever process.
No process writes another's file. It goes when the sweep is over; what stays is the
plan (:mod:`eval.rows.plan`).
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
from typing import Any

import psutil

from eval.rows.store import Row
from sshade.errors import InputError
from sshade.io.files import replacing

#: Folder of the records of sweeps, in the folder of their experiment.
RECORDS = ".sweeps"

#: Launchers whose runs go on when the process that began the sweep ends.
QUEUES = ("slurm", "submitit_slurm")

#: What is told of a row while the sweep lasts.
TOLD = ("method.name", "task.name", "seed", "status", "reason", "seconds.total", "iterations")


@dataclass(frozen=True)
class Sweep:
    """What a sweep is to do.

    Parameters
    ----------
    begin : datetime
    runs : sequence of mappings
        Of each run, in the sweeper's order, the settings that the sweep gives it.
    launcher : str
        For people.
    host : str
        Where the sweep was started.
    code : mapping
        Hashes of the code's files by place, as the process that began the sweep loaded them.
    """

    begin: datetime
    runs: Sequence[Mapping[str, str]]
    launcher: str = "basic"
    host: str = ""
    code: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Ended:
    """A run of a sweep that ended.

    Parameters
    ----------
    number : int
        Its place in the sweep, from 0.
    end : datetime
    row : mapping or None
        What is told of its row, :data:`TOLD`; None where the run ended before it had one.
    found : str
        Where the row was found, which was there before; "" for a new one.
    problems : sequence of str
        Why it counts as failed; empty for a good run.
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
        self._read: dict[str, Ended] = {}

    @classmethod
    def create(cls, experiment: Path, sweep: Sweep) -> SweepRecord:
        """Begin the record of a sweep in the folder of its experiment."""
        record = cls(experiment / RECORDS / f"{sweep.begin:%Y%m%dT%H%M%S.%f}_{os.getpid()}")
        record.folder.mkdir(parents=True)
        content = vars(sweep) | {"begin": sweep.begin.isoformat(), "code": dict(sweep.code)}
        content["host"] = sweep.host or socket.gethostname()
        with replacing(record.folder / "sweep.json") as temporary:
            temporary.write_text(json.dumps(content))
        return record

    def sweep(self) -> Sweep:
        """Read what there is to do."""
        content = json.loads((self.folder / "sweep.json").read_text())
        return Sweep(**content | {"begin": datetime.fromisoformat(content["begin"])})

    def add(self, number: int, *, row: Row | None, found: str = "", problems: Sequence[str] = ()) -> None:
        """Note that a run ended; nothing where the record was removed, the sweep given up."""
        told = row and {name: row.get(name) for name in TOLD}
        end = datetime.now(UTC).isoformat()
        content = {"end": end, "row": told, "found": found, "problems": list(problems)}
        try:
            with replacing(self.folder / f"{number}.json") as temporary:
                temporary.write_text(json.dumps(content))
        except InputError:
            if self.folder.exists():
                raise

    def ended(self) -> list[Ended]:
        """The runs that ended so far; those new since the last call come last, in the order of their ends."""
        new = [self._ended(path) for path in self.folder.glob("[0-9]*.json") if path.name not in self._read]
        for run in sorted(new, key=lambda run: (run.end, run.number)):
            self._read[f"{run.number}.json"] = run
        return list(self._read.values())

    @staticmethod
    def _ended(path: Path) -> Ended:
        content: dict[str, Any] = json.loads(path.read_text())
        return Ended(int(path.stem), **content | {"end": datetime.fromisoformat(content["end"])})

    def given_up(self) -> bool:
        """Whether the sweep was killed: its process is gone. False where none can tell, as elsewhere."""
        sweep, pid = self.sweep(), int(self.folder.name.rpartition("_")[2])
        here = sweep.host == socket.gethostname() and sweep.launcher not in QUEUES
        return here and not psutil.pid_exists(pid)

    def remove(self) -> None:
        """Delete the record; the rows stay."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def complete(self) -> None:
        """Delete the record, and older ones of the same runs: what those had left is done."""
        runs = self.sweep().runs
        for other in records(self.folder.parents[1]):
            if other.folder.name < self.folder.name and other.sweep().runs == runs:
                other.remove()
        self.remove()


def records(experiment: Path) -> list[SweepRecord]:
    """The sweeps under way, or left unfinished, in the folder of an experiment; the oldest first."""
    return [SweepRecord(path.parent) for path in sorted(experiment.glob(f"{RECORDS}/*/sweep.json"))]


def unfinished(experiment: Path) -> list[Sweep]:
    """The sweeps of an experiment that may be under way: begun, not ended, and not known to be killed."""
    found = []
    for record in records(experiment):
        with suppress(FileNotFoundError):  # it ended meanwhile
            if not record.given_up():
                found.append(record.sweep())
    return found


def counts(sweep: Sweep, ended: Sequence[Ended]) -> str:
    """How far a sweep is: "3 done, 1 failed, 5 remaining"."""
    failed = sum(1 for run in ended if run.problems)
    return f"{len(ended)} done, {failed} failed, {len(sweep.runs) - len(ended)} remaining"


def run_line(run: Ended) -> str:
    """A sweep's run in one line."""
    row = run.row
    if row is None:
        return f"run {run.number}: {'; '.join(run.problems)}"
    text = f"{row['method.name']} {row['task.name']} seed {row['seed']}: {status_text(row, found=run.found)}"
    # The reason of a failed run stands in its status already.
    return f"{text} - {'; '.join(run.problems)}" if run.problems and row.get("seconds.total") else text


def status_text(row: Mapping[str, Any], *, found: str) -> str:
    """What became of a run: "ok, 1.23 s, 40 iterations"."""
    if row.get("seconds.total") is None:
        return f"{row['status']} ({row['reason']})"
    text = f"{row['status']}, {row['seconds.total']:.2f} s, {row['iterations']:g} iterations"
    return f"{text}, {found}" if found else text


def summary(sweep: Sweep, ended: Sequence[Ended]) -> str:
    """A sweep that is over: new rows by status, and those that were there."""
    new = [run.row["status"] if run.row else "failed" for run in ended if not run.found]
    by_status = ", ".join(f"{new.count(status)} {status}" for status in sorted(set(new)))
    text = f"{len(sweep.runs)} runs: {len(new)} new{f' ({by_status})' if by_status else ''}"
    text += f", {len(ended) - len(new)} kept"
    missing = len(sweep.runs) - len(ended)
    return f"{text}, {missing} not done" if missing else text
