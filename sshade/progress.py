"""How long computations say how far they are."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the advance of a long computation: stage, steps done, steps in all, a short note."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None: ...


def silent(stage: str, done: int, total: int, note: str = "") -> None:
    """Show nothing: the default progress callback."""
