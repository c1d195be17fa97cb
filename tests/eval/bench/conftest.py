"""Fixtures for tests of times: a simulated machine, which is quiet unless a test sets a load."""

import os
from time import perf_counter, process_time

import pytest

import eval.bench.jobs
import eval.bench.turns
from eval.bench.turns import Reading


class Machine:
    """Simulate the counters of a machine with other processes.

    Each value of `load` holds for one span; the last value holds for all later spans as well.
    """

    def __init__(self, *load: float) -> None:
        self.load = list(load)
        self.before: Reading | None = None
        self.others = 0.0

    def __call__(self) -> Reading:
        own = process_time()
        now = Reading(perf_counter(), own, own)
        if self.before is not None:
            share = self.load.pop(0) if len(self.load) > 1 else self.load[0]
            self.others += share * os.cpu_count() * (now.seconds - self.before.seconds)
        self.before = None if self.before is not None else now
        return now._replace(busy=own + self.others)


@pytest.fixture
def machine(monkeypatch):
    """Return a function that sets the load of other processes during each repeat.

    Repeats may be short, and they run in this process.
    """

    def set_load(*load: float) -> None:
        monkeypatch.setattr(eval.bench.turns, "read_machine", Machine(*load))

    set_load(0.0)
    monkeypatch.setattr(eval.bench.turns, "SHORTEST", 1e-3)
    monkeypatch.setattr(eval.bench.jobs, "in_new_process", lambda function, *given: function(*given))
    return set_load
