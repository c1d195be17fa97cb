"""What a sweep knows of itself, in files: so that any process, on any machine, can tell how far it is.

A sweep has a folder ``<runs>/<experiment>/.sweeps/<id>`` with ``sweep.json``,
what there is to do, and one file for each run that ended, by whichever process:
it names the run's row, which holds the rest. No process writes another's file.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from eval.rows.store import Row, read_row
from sshade.errors import InputError
from sshade.io.files import replacing

#: Folder of the records of sweeps, in the folder of their experiment.
RECORDS = ".sweeps"

#: Settings that do not change how long a run takes.
ONE_OF_A_KIND = ("case", "subject", "pose", "seed")

#: An estimate that lies this near is told in seconds, not as a time of day.
SOON = timedelta(seconds=90)


@dataclass(frozen=True)
class Plan:
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
    """

    begin: datetime
    runs: Sequence[Mapping[str, str]]
    launcher: str = "basic"
    host: str = ""

    def kind(self, number: int) -> str:
        """A run's settings but for the case and the seed: runs of one kind take about equally long."""
        return " ".join(f"{k}={v}" for k, v in self.runs[number].items() if k not in ONE_OF_A_KIND)


@dataclass(frozen=True)
class Ended:
    """A run of a sweep that ended.

    Parameters
    ----------
    number : int
        Its place in the sweep, from 0.
    end : datetime
    seconds : float
        Wall time of the whole run: reading, warm-up, method, metrics.
    row : mapping or None
        None where the run ended before it had one.
    kept : bool
        The row was there before.
    problems : sequence of str
        Why it counts as failed; empty for a good run.
    """

    number: int
    end: datetime
    seconds: float
    row: Row | None
    kept: bool = False
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
    def create(cls, experiment: Path, plan: Plan) -> SweepRecord:
        """Begin the record of a sweep in the folder of its experiment."""
        name = f"{plan.begin:%Y%m%dT%H%M%S.%f}_{os.getpid()}"
        record = cls(experiment / RECORDS / name)
        for last in (*[False] * 9, True):
            try:
                record.folder.mkdir(parents=True)
                break
            except FileNotFoundError:  # a sweep beside this one has just removed the folder above
                if last:
                    raise
        content = asdict(plan) | {"begin": plan.begin.isoformat(), "host": plan.host or socket.gethostname()}
        with replacing(record.folder / "sweep.json") as temporary:
            temporary.write_text(json.dumps(content))
        return record

    def plan(self) -> Plan:
        """Read what there is to do."""
        content = json.loads((self.folder / "sweep.json").read_text())
        return Plan(**content | {"begin": datetime.fromisoformat(content["begin"])})

    def add(
        self,
        number: int,
        *,
        seconds: float,
        row_folder: Path | None,
        kept: bool = False,
        problems: Sequence[str] = (),
    ) -> None:
        """Note that a run ended; nothing where the record was removed, the sweep given up."""
        path = os.path.relpath(row_folder, self.folder) if row_folder else None
        end = datetime.now(UTC).isoformat()
        content = {"end": end, "seconds": seconds, "row": path, "kept": kept, "problems": list(problems)}
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
        row = read_row(path.parent / content["row"]) if content["row"] else None
        return Ended(int(path.stem), **content | {"end": datetime.fromisoformat(content["end"]), "row": row})

    def remove(self) -> None:
        """Delete the record; the rows stay."""
        shutil.rmtree(self.folder, ignore_errors=True)
        with suppress(OSError):  # records of others are there, or they have removed it
            self.folder.parent.rmdir()


def estimated_end(plan: Plan, ended: Sequence[Ended], *, now: datetime) -> datetime | None:
    """When a sweep ends if what is left goes on like what has been done; None if nothing tells.

    The work left is, for each run not ended, the mean time of the new runs of its
    kind, else of the kept rows of its kind, else of all new runs. How many runs
    are under way at once is measured, not asked: the time of the new runs
    together over the time since the sweep began.
    """
    new = [run for run in ended if not run.kept and run.row is not None]
    if not new:
        return None
    last = max(run.end for run in ended)
    busy = sum(run.seconds for run in new)
    at_once = max(busy / max((last - plan.begin).total_seconds(), 1e-3), 1e-3)
    typical = {**_means(plan, [run for run in ended if run.kept]), **_means(plan, new)}
    done = {run.number for run in ended}
    numbers = [i for i in range(len(plan.runs)) if i not in done]
    left = [typical.get(plan.kind(i), busy / len(new)) for i in numbers]
    waiting = left[max(1, round(at_once)) :]  # those under way may be about to end, these are not
    return max(
        last + timedelta(seconds=sum(left) / at_once),
        now + timedelta(seconds=sum(waiting) / at_once),
    )


def _means(plan: Plan, runs: Sequence[Ended]) -> dict[str, float]:
    """Mean seconds by kind; of a kept row, those that its method took."""
    seconds: defaultdict[str, list[float]] = defaultdict(list)
    for run in runs:
        took = run.seconds if not run.kept else (run.row or {}).get("seconds.total")
        if took is not None:
            seconds[plan.kind(run.number)].append(took)
    return {kind: sum(values) / len(values) for kind, values in seconds.items()}


def told_end(end: datetime, now: datetime) -> str:
    """An estimated end for people: "end in about 20 s", "end about 17:05", "end about 17:05 on 3 May"."""
    left = end - now
    if left < SOON:
        seconds = round(left.total_seconds())
        return f"end in about {seconds} s" if seconds > 0 else "end any moment"
    local, today = end.astimezone(), now.astimezone().date()
    day = "" if local.date() == today else f" on {local.day} {local:%B}"
    return f"end about {local:%H:%M}{day}"


def told_counts(plan: Plan, ended: Sequence[Ended], *, now: datetime) -> str:
    """How far a sweep is: "3 done, 1 failed, 5 remaining, end about 17:05"."""
    failed = sum(1 for run in ended if run.problems)
    remaining = len(plan.runs) - len(ended)
    text = f"{len(ended)} done, {failed} failed, {remaining} remaining"
    end = estimated_end(plan, ended, now=now) if remaining else None
    return f"{text}, {told_end(end, now)}" if end else text


def told_run(run: Ended) -> str:
    """A sweep's run in one line."""
    row = run.row
    if row is None:
        return f"run {run.number}: {'; '.join(run.problems)}"
    text = f"{row['method.name']} {row['task.name']} seed {row['seed']}: {told_status(row, kept=run.kept)}"
    # The reason of a failed run stands in its status already.
    return f"{text} - {'; '.join(run.problems)}" if run.problems and row.get("seconds.total") else text


def told_status(row: Mapping[str, Any], *, kept: bool) -> str:
    """What became of a run: "ok, 1.23 s, 40 iterations"."""
    if row.get("seconds.total") is None:
        return f"{row['status']} ({row['reason']})"
    text = f"{row['status']}, {row['seconds.total']:.2f} s, {row['iterations']:g} iterations"
    return f"{text}, already there" if kept else text


def told_summary(plan: Plan, ended: Sequence[Ended]) -> str:
    """A sweep that is over: new rows by status, and those that were there."""
    new = [run.row["status"] if run.row else "failed" for run in ended if not run.kept]
    kept = sum(1 for run in ended if run.kept)
    counts = ", ".join(f"{new.count(status)} {status}" for status in sorted(set(new)))
    text = f"{len(plan.runs)} runs: {len(new)} new{f' ({counts})' if counts else ''}, {kept} kept"
    missing = len(plan.runs) - len(ended)
    return f"{text}, {missing} not done" if missing else text


def records(experiment: Path) -> list[SweepRecord]:
    """The sweeps under way, or left unfinished, in the folder of an experiment; the oldest first."""
    return [SweepRecord(path.parent) for path in sorted(experiment.glob(f"{RECORDS}/*/sweep.json"))]


def forget(record: SweepRecord) -> None:
    """Remove the record of a sweep, and older ones of the same runs: what they had left is done."""
    runs = record.plan().runs
    for other in records(record.folder.parents[1]):
        if other.folder.name < record.folder.name and other.plan().runs == runs:
            other.remove()
    record.remove()
