"""The callback through which long computations report their progress."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives progress reports: the stage, the number of steps done, their total, and a short note."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None: ...


def silent(stage: str, done: int, total: int, note: str = "") -> None:
    """Report nothing; the default progress callback."""


def renamed(progress: Progress, stage: str) -> Progress:
    """Return a callback that reports to `progress` under another name of the stage."""
    return lambda _, done, total, note="": progress(stage, done, total, note)
