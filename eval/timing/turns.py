"""Repeat several jobs in turns, each repeat on a quiet machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence, Set
from datetime import UTC, datetime
from time import perf_counter
from typing import NamedTuple

import numpy as np

from eval.rows.store import SCHEMA, Row
from eval.run.code import code_version, digest, require_unchanged
from eval.run.provenance import environment
from eval.timing.quiet import between, busiest_other, read_machine
from sshade.core.console import say
from sshade.core.errors import InputError

#: What is timed, the column ``kind`` of rows.
SPEED, DRAG, SCALING, WHOLE = "speed", "drag", "scaling", "whole"
#: Shortest repeat in seconds; a shorter call runs several times. CPU times of shorter spans are too coarse.
SHORTEST = 1.0
#: A job whose warm-up takes more seconds has the warm-up as its only repeat.
LONG = 60.0
#: Functions behind the command and the bound deformer, whose code all times depend on.
FUNCTIONS = frozenset({"sshade.deform", "sshade.Deformer"})
#: Number of consecutive rejected repeats after which the command gives up.
ATTEMPTS = 5


class Job(NamedTuple):
    """A call to time.

    Parameters
    ----------
    facts : dict
        Columns that identify the job: ``method.*``, ``task.*``.
    call : callable
        Runs once and returns further columns, at least ``seconds.total``.
    code : set of str
        Names of further code that the call depends on, as :func:`eval.run.targets.code_of` gives them.
    """

    facts: Row
    call: Callable[[], Row]
    code: Set[str] = frozenset()

    def __str__(self) -> str:
        return f"{self.facts['method.name']} on {self.facts['task.name']}"


def take_turns(jobs: Sequence[Job], *, rounds: int) -> list[Row]:
    """Time several jobs in turns (A B C A B C ...), so that a slow drift of the machine affects all of them.

    Each job has a warm-up, which does not count unless it takes longer than :data:`LONG`. A repeat is
    rejected and run again if other processes used too much CPU, or the clock jumped.

    Parameters
    ----------
    jobs : sequence of Job
    rounds : int
        Number of accepted repeats of each job.

    Returns
    -------
    list of dict
        One row per repeat. ``seconds.*`` are means over the ``calls`` of the repeat; ``cores_used`` and
        ``other_cores`` are CPU use during the repeat; ``kept`` says whether the repeat counts, and
        ``reason`` why not.

    Raises
    ------
    InputError
        When :data:`ATTEMPTS` consecutive repeats were rejected.
    """
    targets = {value for job in jobs for name, value in job.facts.items() if name.endswith(".target")}
    functions = FUNCTIONS.union(targets, *(job.code for job in jobs))
    version = code_version(functions)
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
    seen = Counter[tuple[str, ...]]()
    for row in rows:
        job_id = row["method.name"], row["task.name"], row["task.checksum"]
        seen[job_id] += 1
        row |= {"repeat": seen[job_id], "env.version.code": version}
    require_unchanged(functions)
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
            busiest = busiest_other()
            who = f"; the busiest is {busiest}" if busiest else ""
            raise InputError(
                f"the machine is not quiet: {len(rows)} repeats of {job} in a row were rejected, the last "
                f"because {row['reason']}{who}; end other programs and time again; nothing was written"
            )
        rows.append(_repeat(job, number=row["round"], least=SHORTEST))


def _repeat(job: Job, *, number: int, least: float) -> Row:
    """Call the job until `least` seconds have passed; return the row of the repeat."""
    before = read_machine()
    results = [job.call()]
    while perf_counter() - before.seconds < least:
        results.append(job.call())
    use = between(before, read_machine())
    row = job.facts | {"round": number, "calls": len(results), "seed": 0, "schema": SCHEMA}
    row |= {f"env.{fact}": value for fact, value in environment(jobs=1).items()}
    row |= results[-1]
    row |= {name: float(np.mean([r[name] for r in results])) for name in row if name.startswith("seconds.")}
    row |= {"seconds.repeat": use.seconds, "env.cores_used": use.cores_used, "other_cores": use.others}
    row["status"] = "not_converged" if row.get("converged") is False else "ok"
    row |= {"kept": not use.problem, "reason": use.problem}
    row["date"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    row["key"] = digest(row["method.hash"].encode(), row["task.checksum"].encode(), row["date"].encode())
    return row
