"""Independent chunks of work in threads; the heavy kernels run without the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar, cast

from sshade.errors import InputError

Result = TypeVar("Result")

#: Rows of arrays that a thread of :func:`in_ranges` works on at a time, each time with arrays of its own.
CHUNK = 65_536
#: As of :meth:`ThreadTeam.ranges`, which little work is done with, many times: they stay in the cache.
ROWS = 16_384


def available_cpus() -> int:
    """Number of CPUs that this process may use: fewer than the machine's under Slurm or taskset."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def number_of_workers(workers: int | None, *, default: int) -> int:
    """`workers`, or `default` for None; InputError on fewer than one."""
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers were asked for; at least one is needed")
    return workers or default


def in_threads(chunk: Callable[[int], Result], count: int, *, workers: int | None = None) -> list[Result]:
    """``[chunk(0), ..., chunk(count - 1)]``, in that order whatever the number of threads.

    Parameters
    ----------
    chunk : callable
    count : int
    workers : int, optional
        Threads at most; by default two for each CPU, so that the scheduler evens out a
        number of chunks that the CPUs do not divide. With one, the calling thread works.

    Raises
    ------
    InputError
        On fewer than one worker.
    Exception
        As of :class:`ThreadTeam`.
    """
    workers = number_of_workers(workers, default=2 * available_cpus())
    with ThreadTeam(max(1, min(workers, count))) as team:
        return team(chunk, count)


def in_ranges(work: Callable[[int, int], Result], n: int) -> list[Result]:
    """``[work(first, end), ...]`` for ranges that cover n rows in order, in a thread for each CPU.

    The ranges do not depend on the number of threads; few rows are one range, of the calling thread.
    """
    with ThreadTeam(available_cpus() if n > CHUNK else 1) as team:
        return team.ranges(work, n, rows=CHUNK)


class ThreadTeam:
    """Threads that stay for many short chunks of work, in a ``with`` block or as long as something has them.

    Parameters
    ----------
    workers : int
        Threads, the calling one among them.

    Raises
    ------
    InputError
        On fewer than one worker.
    """

    def __init__(self, workers: int) -> None:
        self.workers = number_of_workers(workers, default=1)
        self._pool = ThreadPoolExecutor(max_workers=workers - 1) if workers > 1 else None

    def __enter__(self) -> ThreadTeam:
        return self

    def __exit__(self, *error: object) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def __call__(self, chunk: Callable[[int], Result], count: int) -> list[Result]:
        """``[chunk(0), ..., chunk(count - 1)]``, once all are done.

        Where chunks fail, those not yet begun are dropped, and the error of the first
        one in their order is raised.
        """
        if self._pool is None or count == 1:
            return [chunk(i) for i in range(count)]

        results: list[Result | None] = [None] * count
        errors: dict[int, BaseException] = {}
        numbers = iter(range(count))

        def work() -> None:
            for i in numbers:  # whoever is free takes the next: threads may not be equally fast
                if errors:
                    return
                try:
                    results[i] = chunk(i)
                except BaseException as error:
                    errors[i] = error

        others = [self._pool.submit(work) for _ in range(min(self.workers, count) - 1)]
        work()
        wait(others)
        if errors:
            raise errors[min(errors)]
        return cast(list[Result], results)

    def ranges(self, work: Callable[[int, int], Result], n: int, *, rows: int | None = None) -> list[Result]:
        """``[work(first, end), ...]`` for ranges that cover n rows in order, :data:`ROWS` each by default."""
        bounds = [*range(0, n, rows or ROWS), n]
        return self(lambda i: work(bounds[i], bounds[i + 1]), len(bounds) - 1)
