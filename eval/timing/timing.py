"""Repeated timings of runs that take turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np


@dataclass
class Timing:
    """Wall-clock seconds of the repeats of one configuration, and the last result."""

    seconds: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)
    result: Any = None

    def add(self, run: Callable[[], Any]) -> None:
        """Run once on the clock."""
        begin = perf_counter()
        self.result = run()
        self.seconds.append(perf_counter() - begin)
        self.stages.append(dict(getattr(self.result, "seconds", {})))

    @property
    def median(self) -> float:
        """Median wall-clock seconds."""
        return float(np.median(self.seconds))

    def stage(self, name: str) -> float:
        """Median seconds of a stage that the result reports."""
        return float(np.median([stages[name] for stages in self.stages]))


def take_turns(runs: dict[str, Callable[[], Any]], repeats: int) -> dict[str, Timing]:
    """Time several runs, one after the other, `repeats` times: a drift of the machine meets all."""
    timings = {name: Timing() for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            timings[name].add(run)
    return timings


def say(text: str) -> None:
    """Print a line at once, also where the output is no terminal."""
    print(text, flush=True)  # noqa: T201
