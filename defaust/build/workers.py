"""Build subjects in this process, or several at a time in worker processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

from defaust.build.options import BuildOptions
from defaust.build.subject import UnusableError, build_subject
from defaust.sources.source import Source
from sshade.core.errors import InputError


def build_subjects(
    source: Source,
    out: Path,
    *,
    subjects: Sequence[int],
    options: BuildOptions,
    strict: bool,
    workers: int,
) -> Iterator[tuple[int, dict[str, Any] | UnusableError]]:
    """Build subjects; yield each with its record, or with the reason why it cannot be used.

    The order of the subjects depends on which is finished first.

    Parameters
    ----------
    source : Source
    out : Path
        The dataset's folder, which must exist.
    subjects : sequence of int
    options : BuildOptions
    strict : bool
        Raise an UnusableError instead of yielding it.
    workers : int
        Number of processes; 1 builds in this process.

    Raises
    ------
    InputError
        See :func:`defaust.build.subject.build_subject`.
    """
    job = partial(_build, source, out, options=options, strict=strict)
    if workers == 1:
        for s in subjects:
            yield s, job(subject=s)
        return
    # Spawned, because forking a process with threads (numba, BLAS) can hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker) as pool:
        jobs = {pool.submit(job, subject=s): s for s in subjects}
        try:
            for finished in as_completed(jobs):
                yield jobs[finished], finished.result()
        except BrokenProcessPool as error:
            raise InputError(
                "a process of the build was killed, perhaps for lack of memory; the same command continues, "
                "with fewer workers if you give workers=1"
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _build(source: Source, out: Path, *, strict: bool, **settings: Any) -> dict[str, Any] | UnusableError:
    try:
        return build_subject(source, out, strict=strict, **settings)
    except UnusableError as error:
        if strict:
            raise
        return error


def _start_worker() -> None:
    # Ctrl-C reaches the workers too. They end silently; the main process reports it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _end_with_parent()


def _end_with_parent() -> None:
    """End this process as soon as its parent process ends.

    A parent that is killed cannot stop its children, and they would go on working.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()
