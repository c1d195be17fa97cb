"""Whether a machine was quiet: the CPU time that other processes used, and whether a clock jumped."""

from __future__ import annotations

import os
from contextlib import suppress
from time import perf_counter, process_time, sleep, time
from typing import NamedTuple

import psutil

#: Share of the machine's cores that others may use during a repeat.
OTHERS = 0.05
#: Seconds, and share of a span, by which the wall clock may leave the monotonic one; NTP slews it by less.
DRIFT = (0.1, 1e-3)
#: Seconds over which the busiest other process is looked for.
SEARCH = 1.0


class Reading(NamedTuple):
    """Counters of the machine at an instant.

    Attributes
    ----------
    seconds, clock : float
        The monotonic clock and the wall clock, seconds.
    busy : float
        CPU seconds of all cores that were not idle, since boot. What a hypervisor gave to others counts.
    own : float
        CPU seconds of this process and of those that it began.
    """

    seconds: float
    clock: float
    busy: float
    own: float


class Use(NamedTuple):
    """What happened between two readings.

    Attributes
    ----------
    seconds : float
    cores_used : float
        CPU seconds of the own process tree, over `seconds`.
    others : float
        CPU seconds of other processes, over those of all cores of the machine.
    problem : str
        Why times taken meanwhile do not count; empty where they do.
    """

    seconds: float
    cores_used: float
    others: float
    problem: str


def read_machine() -> Reading:
    """Read the counters of the machine."""
    times = psutil.cpu_times()
    # Linux counts guests in user and nice, too.
    idle = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))
    ended = os.times()
    own = process_time() + ended.children_user + ended.children_system
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it has just ended
            own += sum(child.cpu_times()[:4])
    return Reading(perf_counter(), time(), sum(times) - idle, own)


def between(before: Reading, after: Reading, *, cores: int | None = None) -> Use:
    """Judge the time between two readings.

    The system counts in ticks of 10 ms, so that spans under a second say little
    about others.

    Parameters
    ----------
    before, after : Reading
    cores : int, optional
        Of the machine; by default those that it has.
    """
    cores = cores or psutil.cpu_count()
    span = after.seconds - before.seconds
    jump = after.clock - before.clock - span
    own = after.own - before.own
    others = max(0.0, after.busy - before.busy - own) / (cores * span)
    problem = ""
    if abs(jump) > DRIFT[0] + DRIFT[1] * span:
        problem = f"the clock jumped by {jump:+.1f} s"
    elif others > OTHERS:
        problem = f"other processes used {others:.0%} of the machine's {cores} cores"
    return Use(span, own / span, others, problem)


def busiest_other() -> str:
    """The process of others that uses most CPU just now, in a few words; empty where none stands out."""
    own = {os.getpid(), *(child.pid for child in psutil.Process().children(recursive=True))}
    before = {process: process.info["cpu_times"] for process in psutil.process_iter(["cpu_times"])}
    begin = perf_counter()
    sleep(SEARCH)
    used: dict[psutil.Process, float] = {}
    for process, times in before.items():
        with suppress(psutil.Error):  # it has ended, or is not to be looked at
            if process.pid not in own and times is not None:
                used[process] = sum(process.cpu_times()[:2]) - sum(times[:2])
    share = {process: seconds / (perf_counter() - begin) for process, seconds in used.items()}
    for process in sorted(share, key=share.__getitem__, reverse=True):
        if share[process] <= OTHERS:
            break
        with suppress(psutil.Error):
            # A program of python -c has lines; this is a part of one sentence.
            words = " ".join(" ".join(process.cmdline()).split()) or process.name()
            return f"process {process.pid} ({words[:60]}) with {share[process]:.0%} of a core"
    return ""
