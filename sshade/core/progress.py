"""The callback through which long computations report their progress."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives progress reports: the stage, the number of steps done, their total, and a short note.

    A stage has ended when all its steps are done. A stage that may end early, as an iteration that converges,
    reports the number of its steps as the total at its end. Threads of the computation call it, at times
    at once. An exception of the callback ends the computation, at the latest after the solves
    that other threads have begun.
    """

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None: ...


def silent(stage: str, done: int, total: int, note: str = "") -> None:
    """Report nothing; the default progress callback."""


def renamed(progress: Progress, stage: str, *, within: bool = False) -> Progress:
    """Return a callback that reports to `progress` under another name of the stage.

    With `within`, stages keep their names behind the name of the larger stage: "component 1/2, polish".
    """
    return lambda own, done, total, note="": progress(
        f"{stage}, {own}" if within else stage, done, total, note
    )
