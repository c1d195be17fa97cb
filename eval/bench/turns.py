"""Repeat several jobs in turns, each repeat on a quiet machine."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from time import perf_counter, process_time
from typing import NamedTuple

import numpy as np
import psutil

from eval.rows.store import Row
from eval.run.environment import config_hash, environment
from sshade.core.console import say
from sshade.core.errors import InputError

#: Largest CPU time of other processes during a repeat, as a fraction of all cores.
OTHERS = 0.05
#: Shortest repeat in seconds; a shorter call runs several times. CPU times of shorter spans are too coarse.
SHORTEST = 1.0
#: A job whose warm-up takes more seconds has the warm-up as its only repeat.
LONG = 60.0
#: Number of consecutive rejected repeats after which the command gives up.
ATTEMPTS = 5


class Reading(NamedTuple):
    """Counters of the machine at an instant.

    Attributes
    ----------
    seconds : float
        A steady clock.
    busy : float
        CPU seconds of all cores since boot, without idle time. Time that a hypervisor took counts as busy.
    own : float
        CPU seconds of this process and its children.
    """

    seconds: float
    busy: float
    own: float


def read_machine() -> Reading:
    """Read the counters of the machine."""
    times = psutil.cpu_times()
    # Linux counts the time of guests in user and nice already.
    idle = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))
    ended = os.times()
    own = process_time() + ended.children_user + ended.children_system
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # the child has just ended
            own += sum(child.cpu_times()[:4])
    return Reading(perf_counter(), sum(times) - idle, own)


def used_by_others(before: Reading, after: Reading, *, cores: int | None = None) -> float:
    """Return the CPU time of other processes between two readings, as a fraction of all cores.

    The system counts CPU time in ticks of 10 ms. Spans under a second therefore say little.
    """
    others = after.busy - before.busy - (after.own - before.own)
    return max(0.0, others) / ((cores or psutil.cpu_count()) * (after.seconds - before.seconds))


class Job(NamedTuple):
    """A call to time.

    Parameters
    ----------
    facts : dict
        Columns that identify the job: ``method.*``, ``task.*``.
    call : callable
        Runs once and returns further columns, at least ``seconds.total``.
    """

    facts: Row
    call: Callable[[], Row]

    def __str__(self) -> str:
        return f"{self.facts['method.name']} on {self.facts['task.name']}"


def take_turns(jobs: Sequence[Job], *, rounds: int) -> list[Row]:
    """Time several jobs in turns (A B C A B C ...), so that a slow drift of the machine affects all of them.

    Each job has a warm-up, which does not count unless it takes longer than :data:`LONG`. A repeat is
    rejected and run again if other processes used too much CPU.

    Parameters
    ----------
    jobs : sequence of Job
    rounds : int
        Number of accepted repeats of each job.

    Returns
    -------
    list of dict
        One row per repeat. ``seconds.*`` are means over the ``calls`` of the repeat; ``env.cores_used`` and
        ``other_cores`` are CPU use during the repeat; ``kept`` says whether the repeat counts, and
        ``reason`` why not.

    Raises
    ------
    InputError
        When :data:`ATTEMPTS` consecutive repeats were rejected.
    """
    rows: list[Row] = []
    short = []
    for job in jobs:
        say(f"warm-up: {job}")
        first = _repeat(job, number=1, least=0.0)
        if first["seconds.repeat"] > LONG:
            rows += _until_kept(job, [first])
        else:
            short.append(job)
    for number in range(1, rounds + 1):
        for job in short:
            rows += _until_kept(job, [_repeat(job, number=number, least=SHORTEST)])
    return rows


def _until_kept(job: Job, rows: list[Row]) -> list[Row]:
    """Repeat the job until a repeat counts; return all repeats."""
    while True:
        row = rows[-1]
        end = " extrapolated" if "extrapolated_to" in row else ""
        end += "" if row["kept"] else f", rejected: {row['reason']}"
        say(f"round {row['round']}, {job}: {row['seconds.total']:.3g} s{end}")
        if row["kept"]:
            return rows
        if len(rows) == ATTEMPTS:
            raise InputError(
                f"the machine is not quiet: {len(rows)} repeats of {job} in a row were rejected, the last "
                f"because {row['reason']}; end other programs and time again; nothing was written"
            )
        rows.append(_repeat(job, number=row["round"], least=SHORTEST))


def _repeat(job: Job, *, number: int, least: float) -> Row:
    """Call the job until `least` seconds have passed; return the row of the repeat."""
    before = read_machine()
    results = [job.call()]
    while perf_counter() - before.seconds < least:
        results.append(job.call())
    after = read_machine()
    seconds, others = after.seconds - before.seconds, used_by_others(before, after)
    row = job.facts | {"round": number, "calls": len(results), "seed": 0}
    row |= {f"env.{fact}": value for fact, value in environment(jobs=1).items()}
    row |= {"env.cores_used": (after.own - before.own) / seconds} | results[-1]
    row |= {name: float(np.mean([r[name] for r in results])) for name in row if name.startswith("seconds.")}
    row |= {"seconds.repeat": seconds, "other_cores": others, "kept": others <= OTHERS, "reason": ""}
    if not row["kept"]:
        row["reason"] = f"other processes used {others:.0%} of the machine"
    row["status"] = "not_converged" if row.get("converged") is False else "ok"
    row["date"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    row["key"] = config_hash({name: row[name] for name in ("method.hash", "task.checksum", "date")})
    return row
