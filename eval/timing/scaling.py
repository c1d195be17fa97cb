"""Time and memory against the number of vertices, on subdivided meshes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from eval.rows.store import Row
from eval.run.provenance import process_memory, reset_peak_memory
from eval.timing.speed import job_of
from eval.timing.timed_cases import TimedCase, TimedMethod
from eval.timing.turns import Job, take_turns
from sshade.core.console import say

#: Smallest number of vertices of the fit of time against vertices.
FIT_FROM = 100_000
#: Numbers of vertices to measure by default.
SIZES = (10_000, 30_000, 100_000, 300_000, 450_000, 1_000_000, 3_000_000, 5_000_000)


def time_scaling(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time methods on subdivided meshes, and measure their peak memory.

    Each case runs in a new process, in which the methods take turns.

    Returns
    -------
    list of dict
        Rows with ``peak_mib``: the peak of memory during a call, minus the memory before the first call. The
        allocator of glibc first returns memory of earlier calls. None if the system does not report it.

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`.
    """
    return [row for case in cases for row in _in_new_process(_time_case, methods, case, rounds)]


def _in_new_process(function: Callable[..., list[Row]], *arguments: Any) -> list[Row]:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def _time_case(methods: Sequence[TimedMethod], case: TimedCase, rounds: int) -> list[Row]:
    task = case.load()
    say(f"{task.name}: {task.mesh.n:,} vertices")
    jobs = [job_of(method, task) for method in methods]
    before = process_memory("VmRSS")
    return take_turns([job._replace(call=_with_peak(job, before)) for job in jobs], rounds=rounds)


def _with_peak(job: Job, before: int | None) -> Callable[[], Row]:
    """Return a call of the job that adds the peak of memory above `before`, in bytes."""

    def call() -> Row:
        if before is None:
            return job.call() | {"peak_mib": None}
        reset_peak_memory()
        row = job.call()
        return row | {"peak_mib": (process_memory("VmHWM") - before) / 2**20}

    return call


def slopes(table: pd.DataFrame) -> dict[str, float]:
    """Fit the log-log slope of median seconds against vertices, from :data:`FIT_FROM` vertices on.

    Returns
    -------
    dict
        Method -> slope, for methods with at least two such sizes.
    """
    fitted = {}
    for method, own in table[table["vertices"] >= FIT_FROM].groupby("method", sort=False):
        if len(own) > 1:
            x, y = np.log(own["vertices"].astype(float)), np.log(own["seconds.total"].astype(float))
            fitted[str(method)] = float(np.polyfit(x, y, 1)[0])
    return fitted
