"""Wall-clock seconds of the stages of a method."""

from __future__ import annotations

from time import perf_counter


class Stopwatch:
    """Times stages that follow each other.

    Attributes
    ----------
    seconds : dict of str to float
        Duration of each finished stage, in the order in which the stages ended.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._begin = perf_counter()

    def end(self, stage: str) -> None:
        """End the present stage under this name and begin the next one."""
        now = perf_counter()
        self.seconds[stage], self._begin = now - self._begin, now
