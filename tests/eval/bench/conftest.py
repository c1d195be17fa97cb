"""Fixtures for tests of times: a machine that is quiet unless a test sets the load of other processes."""

import pytest

import eval.bench.jobs
import eval.bench.quality
import eval.bench.turns


@pytest.fixture
def machine(monkeypatch):
    """Return a function that sets the load of other processes during each repeat; the last load stays.

    Repeats may be short, and they run in this process.
    """

    def set_load(*load: float) -> None:
        told = list(load)
        shares = lambda *_: told.pop(0) if len(told) > 1 else told[0]  # noqa: E731
        monkeypatch.setattr(eval.bench.turns, "used_by_others", shares)

    set_load(0.0)
    monkeypatch.setattr(eval.bench.turns, "SHORTEST", 1e-3)
    eval.bench.quality._rows.cache_clear()
    monkeypatch.setattr(eval.bench.jobs, "in_new_process", lambda function, *given: function(*given))
    return set_load
