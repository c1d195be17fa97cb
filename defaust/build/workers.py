"""Subjects built in this process or in several at a time."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any

from defaust.build.options import BuildOptions
from defaust.build.subject import UnusableError, build_subject
from defaust.sources.source import Source
from sshade.processes import end_with_parent
from sshade.progress import Progress

#: Seconds between two looks at what the workers report.
POLL = 0.2

#: In a worker: where its progress goes. A queue cannot travel with each job, only at the start.
_stages: Any = None


def build_subjects(
    source: Source,
    out: Path,
    *,
    subjects: Sequence[int],
    options: BuildOptions,
    strict: bool,
    workers: int,
    progress: Progress,
) -> Iterator[tuple[int, dict[str, Any] | UnusableError]]:
    """Build subjects and yield each with its record as it is done, or why it has none, in no certain order.

    Parameters
    ----------
    source : Source
    out : Path
        The dataset's folder, which is there.
    subjects : sequence of int
    options : BuildOptions
    strict : bool
        Raise what cannot be used; else it is left out.
    workers : int
        Processes; with 1, this one works.
    progress : Progress

    Raises
    ------
    InputError
        See :func:`defaust.build.subject.build_subject`.
    """
    settings = {"options": options, "strict": strict}

    def record(build: Callable[[], dict[str, Any]]) -> dict[str, Any] | UnusableError:
        try:
            return build()
        except UnusableError as error:
            if strict:
                raise
            return error

    if workers == 1:
        for s in subjects:
            job = partial(build_subject, source, out, subject=s, progress=progress, **settings)
            yield s, record(job)
        return
    # Spawned, because forking a process with threads (numba, BLAS) can hang.
    context = multiprocessing.get_context("spawn")
    stages = context.SimpleQueue()
    with ProcessPoolExecutor(
        workers, mp_context=context, initializer=_start_worker, initargs=(stages,)
    ) as pool:
        jobs = {
            pool.submit(build_subject, source, out, subject=s, progress=_report, **settings): s
            for s in subjects
        }
        waiting = set(jobs)
        try:
            while waiting:
                done, waiting = wait(waiting, timeout=POLL, return_when=FIRST_COMPLETED)
                while not stages.empty():
                    progress(*stages.get())
                for job in done:
                    yield jobs[job], record(job.result)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _start_worker(stages: Any) -> None:
    global _stages
    _stages = stages
    # Ctrl-C reaches the workers too: they end at once, and the main process says so.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


def _report(stage: str, done: int, total: int, note: str = "") -> None:
    """Progress of a worker, sent to the process that draws."""
    _stages.put((stage, done, total, note))
