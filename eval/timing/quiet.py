"""Check that a machine was quiet: the CPU time of other processes, and jumps of the clock."""

from __future__ import annotations

import os
from contextlib import suppress
from time import perf_counter, process_time, sleep, time
from typing import NamedTuple

import psutil

#: Largest CPU time of other processes during a repeat, as a fraction of all cores.
OTHERS = 0.05
#: Largest drift of the wall clock from the monotonic clock: seconds, and a fraction of the span.
#: NTP adjusts the wall clock by less.
DRIFT = (0.1, 1e-3)
#: Seconds during which the busiest other process is observed.
SEARCH = 1.0


class Reading(NamedTuple):
    """Counters of the machine at an instant.

    Attributes
    ----------
    seconds, clock : float
        The monotonic clock and the wall clock, in seconds.
    busy : float
        CPU seconds of all cores since boot, without idle time. Time that a hypervisor took counts as busy.
    own : float
        CPU seconds of this process and its children.
    """

    seconds: float
    clock: float
    busy: float
    own: float


class Use(NamedTuple):
    """The use of the machine between two readings.

    Attributes
    ----------
    seconds : float
    cores_used : float
        CPU seconds of this process and its children, divided by `seconds`.
    others : float
        CPU time of other processes, as a fraction of all cores of the machine.
    problem : str
        Why times of this span do not count; empty if they count.
    """

    seconds: float
    cores_used: float
    others: float
    problem: str


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
    return Reading(perf_counter(), time(), sum(times) - idle, own)


def between(before: Reading, after: Reading, *, cores: int | None = None) -> Use:
    """Judge the span between two readings.

    The system counts CPU time in ticks of 10 ms. Spans under a second therefore say little about other
    processes.

    Parameters
    ----------
    before, after : Reading
    cores : int, optional
        Cores of the machine; by default the cores of this machine.
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
    """Describe the other process that uses most CPU; empty if no process uses much."""
    own = {os.getpid(), *(child.pid for child in psutil.Process().children(recursive=True))}
    used: dict[psutil.Process, float] = dict.fromkeys(psutil.process_iter(), 0.0)
    for wait in (0.0, SEARCH):  # the first call of cpu_percent sets the counters
        sleep(wait)
        for process in used:
            with suppress(psutil.Error):  # the process has ended, or hides its counters
                used[process] = 0.0 if process.pid in own else process.cpu_percent() / 100
    busiest = max(used, key=used.__getitem__)
    if used[busiest] <= OTHERS:
        return ""
    with suppress(psutil.Error):
        # A program given by python -c has several lines.
        words = " ".join(" ".join(busiest.cmdline()).split()) or busiest.name()
        return f"process {busiest.pid} ({words[:60]}) with {used[busiest]:.0%} of a core"
    return ""
