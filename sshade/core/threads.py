"""Independent chunks of work in threads. Heavy kernels run without the GIL."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from queue import SimpleQueue
from threading import Thread
from typing import Any, Generic, Protocol, TypeVar, cast

from sshade.core.errors import InputError, counted

Result = TypeVar("Result")
Covariant = TypeVar("Covariant", covariant=True)

#: Number of vertices below which a thread costs more than it saves.
SMALL = 1000
#: Number of rows in a range of :func:`in_ranges`, for work that allocates arrays for each range.
CHUNK = 65_536
#: Number of rows in a range of :meth:`ThreadTeam.ranges`, for short repeated work: rows stay in the cache.
ROWS = 16_384


def available_cpus() -> int:
    """Return the number of CPUs that this process may use, which Slurm or taskset may restrict."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def number_of_workers(workers: int | None, *, default: int) -> int:
    """Return `workers`, or `default` for None; raise InputError on fewer than one."""
    if workers is not None and workers < 1:
        raise InputError(
            f"{counted(workers, 'worker was', 'workers were')} asked for; at least one is needed"
        )
    return workers or default


def in_threads(chunk: Callable[[int], Result], count: int, *, workers: int | None = None) -> list[Result]:
    """Return ``[chunk(0), ..., chunk(count - 1)]``, in this order for any number of threads.

    Parameters
    ----------
    chunk : callable
        Work for a number in [0, count).
    count : int
        Number of chunks.
    workers : int, optional
        Largest number of threads. The default, two for each CPU, balances the load if the CPUs do not divide
        the number of chunks. With one, the calling thread does all work.

    Raises
    ------
    InputError
        On fewer than one worker.
    Exception
        The error of the first chunk that failed; see :class:`ThreadTeam`.
    """
    workers = number_of_workers(workers, default=2 * available_cpus())
    with ThreadTeam(max(1, min(workers, count))) as team:
        return team(chunk, count)


def in_turn(chunk: Callable[[int], Result], count: int) -> list[Result]:
    """Return ``[chunk(0), ..., chunk(count - 1)]`` by the calling thread, as a team of one does."""
    return list(map(chunk, range(count)))


def in_ranges(work: Callable[..., Result], n: int, *arguments: Any) -> list[Result]:
    """Return ``[work(first, end, *arguments), ...]`` for ranges that cover n rows, in order.

    A thread for each CPU works. Ranges have :data:`CHUNK` rows for any number of threads. The calling thread
    works on a single range.
    """
    with ThreadTeam(available_cpus() if n > CHUNK else 1) as team:
        return team.ranges(work, n, *arguments, rows=CHUNK)


@contextmanager
def beside(work: Callable[[], Result], *, size: int) -> Iterator[Pending[Result]]:
    """Run `work` in a thread beside a ``with`` block; the block ends when both have ended.

    Parameters
    ----------
    work : callable
    size : int
        Number of vertices that the work is about. Below :data:`SMALL` there is no thread, and the work is
        done when its result is asked for.
    """
    if size < SMALL:
        yield Later(work)
        return
    with ThreadPoolExecutor(max_workers=1) as pool:
        yield pool.submit(work)


class Pending(Protocol[Covariant]):
    """Work whose result is asked for later, such as a Future."""

    def result(self) -> Covariant: ...


class Later(Generic[Result]):
    """Work that is done when its result is first asked for."""

    def __init__(self, work: Callable[[], Result]) -> None:
        self.result: Callable[[], Result] = cache(work)


class ThreadTeam:
    """Threads for many short chunks of work. They end with a ``with`` block or with the object.

    Parameters
    ----------
    workers : int
        Number of threads, including the calling one.

    Raises
    ------
    InputError
        On fewer than one worker.
    """

    # A queue takes half the time of a ThreadPoolExecutor, which counts for chunks of 100 microseconds.
    def __init__(self, workers: int) -> None:
        self.workers = number_of_workers(workers, default=1)
        self._begin()

    def _begin(self) -> None:
        """Begin without threads, and with a queue that no thread has used."""
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._threads: list[Thread] = []
        weakref.finalize(self, self._tasks.put, None)

    def __enter__(self) -> ThreadTeam:
        return self

    def __exit__(self, *error: object) -> None:
        self.workers = 1  # a later call has no threads
        self._tasks.put(None)
        for thread in self._threads:
            thread.join()

    def __call__(self, chunk: Callable[[int], Result], count: int) -> list[Result]:
        """Return ``[chunk(0), ..., chunk(count - 1)]``.

        If a chunk fails, chunks that have not begun are dropped, and the error of the smallest failed number
        is raised.
        """
        others = min(self.workers, count) - 1
        if others <= 0:
            return list(map(chunk, range(count)))

        results: list[Result | None] = [None] * count
        errors: dict[int, BaseException] = {}
        numbers, done = iter(range(count)), SimpleQueue[None]()

        def work() -> None:
            for i in numbers:  # threads may differ in speed, so each takes the next number when it is free
                if errors:
                    return
                try:
                    results[i] = chunk(i)
                except BaseException as error:
                    errors[i] = error

        def help_out() -> None:
            work()
            done.put(None)

        if not all(thread.is_alive() for thread in self._threads):
            self._begin()  # a forked process has no threads, and one of them may have locked the queue
        while len(self._threads) < others:
            thread = Thread(target=_serve, args=(self._tasks,), daemon=True)
            thread.start()
            self._threads.append(thread)
        for _ in range(others):
            self._tasks.put(help_out)
        work()
        for _ in range(others):
            done.get()
        if errors:
            raise errors[min(errors)]
        return cast(list[Result], results)

    def ranges(
        self, work: Callable[..., Result], n: int, *arguments: Any, rows: int | None = None
    ) -> list[Result]:
        """Return ``[work(first, end, *arguments), ...]`` for ranges of `rows` rows out of n, in order.

        By default a range has :data:`ROWS` rows.
        """
        bounds = [*range(0, n, rows or ROWS), n]
        return self(lambda i: work(bounds[i], bounds[i + 1], *arguments), len(bounds) - 1)


def _serve(tasks: SimpleQueue[Callable[[], None] | None]) -> None:
    """Do tasks until one is None, which all other threads get as well."""
    while (task := tasks.get()) is not None:
        task()
        del task  # so that its arrays are freed while the thread waits
    tasks.put(None)  # an interrupt may have left a thread out of the list of the team
