"""Times of methods that other programs on the machine hardly change, for ``sshade-eval check``.

A time is the CPU seconds of a call on one CPU. Its unit is the time of a clock, a call of another method: all
take turns, and the least of several rounds counts. Seconds in which the process needs no CPU, as in a sleep,
are counted apart. Each call has new meshes, and targets moved by a hair.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import count
from math import inf
from pathlib import Path
from threading import Event, Thread, get_native_id
from time import perf_counter, process_time, thread_time
from typing import Any, NamedTuple

import numpy as np

from eval.bench.cases import TimedCase, TimedMethod, deformation, moved
from eval.bench.drags import TOLERANCE, bound, deformer_options
from eval.metrics import Task
from eval.rows.store import VALID
from eval.run.attempt import attempt
from eval.run.config import read_choice, resolved, source_of
from eval.run.warmup import warm_up
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent

#: Largest number of rounds.
ROUNDS = 3
#: Number of steps of a drag from rest to the targets.
STEPS = 10
#: Seconds between two looks at the states of the threads, and the folder that has them; only Linux has it.
PERIOD, THREADS = 0.02, Path("/proc/self/task")


class Pace(NamedTuple):
    """CPU time of a call, in seconds or in calls of a clock, and its seconds of sleep."""

    time: float = inf
    asleep: float = inf

    def or_less(self, other: Pace) -> Pace:
        """Return the least of both."""
        return Pace(min(self.time, other.time), min(self.asleep, other.asleep))


class Timed(NamedTuple):
    """What is timed.

    Attributes
    ----------
    name : str
    task, method : str
        Choices; see :func:`eval.run.config.read_choice`.
    level : int, optional
        Number of midpoint subdivisions of the mesh.
    drag : bool
        Time the binding of the mesh, ``NAME_bind``, and steps of a drag, ``NAME_steps``, in place of a call.
    full : bool
        Only ``sshade-eval check --full`` times it.
    """

    name: str
    task: str
    method: str
    level: int | None = None
    drag: bool = False
    full: bool = False

    @property
    def names(self) -> list[str]:
        """Names of the times."""
        return [f"{self.name}_bind", f"{self.name}_steps"] if self.drag else [self.name]

    def calls(self) -> list[Callable[[], None]]:
        """Return a call for each of the names, in order."""
        method = TimedMethod(self.name, resolved("method", read_choice(self.method)))
        task = _loaded(self.task, self.level)
        tasks = (moved(task, number) for number in count(1))
        if self.drag:
            drag = _Drag(tasks, deformer_options(method))
            return [drag.bind, drag.steps]
        warm_up(method.config, kind=type(task))
        return [lambda: _call(method, next(tasks))]


def paces(
    clock: Timed,
    timed: Sequence[Timed],
    enough: Callable[[str, Pace], bool],
    *,
    progress: Progress = silent,
) -> dict[str, Pace]:
    """Return the least times of several rounds by name, in calls of a clock.

    Parameters
    ----------
    clock : Timed
        The call whose time is the unit. It begins and ends each round.
    timed : sequence of Timed
    enough : callable
        Whether a time needs no further round; there are at most :data:`ROUNDS`.
    progress : Progress

    Returns
    -------
    dict
        By the names of `timed`.
    """
    least = {name: Pace() for one in (clock, *timed) for name in one.names}
    calls = {one: one.calls() for one in (clock, *timed)}
    left = list(timed)
    with on_one_cpu(), _Meter() as meter:
        for number in range(ROUNDS):
            for done, one in enumerate((clock, *left, clock)):
                progress("times", done, len(left) + 2, f"{one.name}, round {number + 1}")
                for name, call in zip(one.names, calls[one], strict=True):
                    least[name] = least[name].or_less(meter.of(call))
            unit = least[clock.name].time
            found = {
                name: Pace(least[name].time / unit, least[name].asleep) for one in timed for name in one.names
            }
            left = [one for one in left if not all(enough(name, found[name]) for name in one.names)]
            if not left:
                break
    return found


@cache
def _loaded(task: str, level: int | None) -> Task:
    return TimedCase(source_of(resolved("dataset", read_choice(task))), level).load()


def _call(method: TimedMethod, task: Task) -> None:
    facts = attempt(method.config, task, seed=0).facts
    if facts["status"] not in VALID:
        raise InputError(f"{method.label} cannot be timed: {facts['reason']}")


class _Drag:
    """Meshes to bind and to drag."""

    def __init__(self, tasks: Iterator[Task], options: dict[str, Any]) -> None:
        self.tasks = tasks
        self.options = options

    def bind(self) -> None:
        """Bind the next mesh, whose properties are not known yet."""
        self.task = deformation(next(self.tasks))
        self.deformer = bound(self.task, self.options)

    def steps(self) -> None:
        """Drag the handles from rest to their targets."""
        target, rest = self.task.handles.target, self.task.mesh.V[self.task.handles.index]
        out = np.empty_like(self.task.mesh.V)
        for number in range(1, STEPS + 1):
            self.deformer.step(rest + number / STEPS * (target - rest), tolerance=TOLERANCE, out=out)
        self.deformer.reset()


@contextmanager
def on_one_cpu() -> Iterator[None]:
    """Let this thread, and threads that it starts, use one CPU, so that CPU seconds are seconds of a call."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


class _Meter:
    """Measure calls in a ``with`` block. A thread looks whether all other threads of the process sleep."""

    def __init__(self) -> None:
        self.asleep = 0.0
        self.own_cpu = 0.0
        self.end = Event()
        self.thread = Thread(target=self._look, daemon=True)

    def __enter__(self) -> _Meter:
        self.thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.end.set()
        self.thread.join()

    def of(self, call: Callable[[], None]) -> Pace:
        """Return the seconds of a call on a CPU, and asleep."""
        cpu, asleep = process_time() - self.own_cpu, self.asleep
        call()
        return Pace(process_time() - self.own_cpu - cpu, self.asleep - asleep)

    def _look(self) -> None:
        here, last, slept = str(get_native_id()), perf_counter(), False
        while not self.end.wait(PERIOD):
            names = os.listdir(THREADS) if THREADS.is_dir() else [here, here]
            now, asleep = perf_counter(), all(_sleeps(name) for name in names if name != here)
            self.asleep += now - last if asleep and slept else 0.0
            last, slept, self.own_cpu = now, asleep, thread_time()


def _sleeps(thread: str) -> bool:
    """Whether a thread of this process neither runs nor waits for a CPU."""
    try:
        return (THREADS / thread / "stat").read_text().rpartition(")")[2].split()[0] == "S"
    except OSError:  # it has just ended
        return True
