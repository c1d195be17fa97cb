"""Independent pieces of work in threads; the heavy kernels run without the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar, cast

from sshade.errors import InputError

Result = TypeVar("Result")


def in_threads(piece: Callable[[int], Result], count: int, *, workers: int | None = None) -> list[Result]:
    """``[piece(0), ..., piece(count - 1)]``, in that order whatever the number of threads.

    Parameters
    ----------
    piece : callable
    count : int
    workers : int, optional
        Threads at most; by default two a processor, so that the scheduler evens out a
        number of pieces that the processors do not divide. With one, the calling
        thread works.

    Raises
    ------
    InputError
        On fewer than one worker.
    Exception
        The first error of a piece, in their order; pieces not yet begun are dropped.
    """
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers were asked for; at least one is needed")
    workers = min(workers or 2 * (os.cpu_count() or 1), count)
    if workers == 1:
        return [piece(i) for i in range(count)]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        futures = [pool.submit(piece, i) for i in range(count)]
        try:
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


class Crew:
    """Threads that stay for many short pieces of work, in a ``with`` block.

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
        if workers < 1:
            raise InputError(f"{workers} workers were asked for; at least one is needed")
        self.workers = workers
        self._pool = ThreadPoolExecutor(max_workers=workers - 1) if workers > 1 else None

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def __call__(self, piece: Callable[[int], Result], count: int) -> list[Result]:
        """``[piece(0), ..., piece(count - 1)]``, once all are done; the first error of a piece otherwise."""
        if self._pool is None or count == 1:
            return [piece(i) for i in range(count)]

        results: list[Result | None] = [None] * count
        following = iter(range(count))

        def share() -> None:
            for i in following:  # whoever is free takes the next: threads may not be equally fast
                results[i] = piece(i)

        others = [self._pool.submit(share) for _ in range(min(self.workers, count) - 1)]
        try:
            share()
        finally:
            wait(others)
        for other in others:
            other.result()
        return cast(list[Result], results)
