"""Repeats of several runs that take turns, each on a machine that is quiet meanwhile."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter

import numpy as np

from eval.rows.store import SCHEMA, Row
from eval.run.provenance import SOURCES, digest, environment
from eval.timing.quiet import between, busiest_other, read_machine
from sshade.cli.console import say
from sshade.errors import InputError

#: Seconds that a repeat takes at least, in several calls where one is shorter: shares of CPU need them.
SHORTEST = 1.0
#: A run that takes more seconds is repeated once.
LONG = 60.0
#: Repeats thrown away in a row after which a machine is not quiet.
ATTEMPTS = 5


@dataclass(frozen=True, eq=False)
class Job:
    """Something to be timed.

    Parameters
    ----------
    facts : dict
        Who and on what: ``method.*``, ``task.*``, ``kind``.
    call : callable
        Runs once and gives what its row says of it; ``seconds.total`` at least.
    """

    facts: Row
    call: Callable[[], Row]

    def __str__(self) -> str:
        return f"{self.facts['method.name']} on {self.facts['task.name']}"


def take_turns(jobs: Sequence[Job], *, rounds: int) -> list[Row]:
    """Time several jobs, one after the other, several times: a drift of the machine meets all.

    Each runs once before, which takes no part, unless it takes longer than
    :data:`LONG`: then it is its only repeat. A repeat during which other
    processes used too much, or a clock jumped, is thrown away and repeated.

    Parameters
    ----------
    jobs : sequence of Job
    rounds : int
        Kept repeats of each.

    Returns
    -------
    list of dict
        A row a repeat: ``seconds.*`` are means over the ``calls`` in it, ``cores_used`` and
        ``other_cores`` shares of CPU during it, ``kept`` whether it counts and ``reason`` why not.

    Raises
    ------
    InputError
        When :data:`ATTEMPTS` repeats in a row were thrown away.
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
    seen = Counter[tuple[str, str]]()
    for row in rows:
        job_id = row["method.name"], row["task.checksum"]
        seen[job_id] += 1
        row["repeat"] = seen[job_id]
    return rows


def _until_kept(job: Job, rows: list[Row]) -> list[Row]:
    """A first repeat, and those that follow until one is kept."""
    while True:
        row = rows[-1]
        end = " extrapolated" if "extrapolated_to" in row else ""
        end += "" if row["kept"] else f", thrown away: {row['reason']}"
        say(f"round {row['round']}, {job}: {row['seconds.total']:.3g} s{end}")
        if row["kept"]:
            return rows
        if len(rows) == ATTEMPTS:
            raise _not_quiet(job, rows)
        rows.append(_repeat(job, number=row["round"], least=SHORTEST))


def _not_quiet(job: Job, rows: list[Row]) -> InputError:
    busiest = busiest_other()
    who = f"; the busiest is {busiest}" if busiest else ""
    return InputError(
        f"the machine is not quiet: {len(rows)} repeats of {job} in a row were thrown away, the last because "
        f"{rows[-1]['reason']}{who}; end what runs beside and time again; nothing was written"
    )


def _repeat(job: Job, *, number: int, least: float) -> Row:
    """The row of calls that take at least so many seconds together."""
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
    row |= {"kept": not use.problem, "reason": use.problem, "env.version.code": SOURCES}
    row["date"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    row["key"] = digest(row["method.hash"].encode(), row["task.checksum"].encode(), row["date"].encode())
    return row
