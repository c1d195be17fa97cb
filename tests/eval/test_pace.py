"""Times of calls: CPU seconds and sleep, the least of some rounds, in calls of a clock."""

import sys
from time import process_time, sleep

import pytest

import eval.pace
from eval.pace import Pace, Timed, paces
from sshade import InputError


def busy(seconds):
    end = process_time() + seconds
    while process_time() < end:
        pass


@pytest.fixture
def calls(monkeypatch):
    """Return a mapping that tests fill with what is called for a name in each round."""
    told = {}
    monkeypatch.setattr(Timed, "calls", lambda one: [told[one.name]])
    return told


CLOCK, ONE = (Timed(name, "task", "method") for name in ("clock", "one"))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the states of threads")
def test_work_and_sleep_are_told_apart(calls):
    calls |= {"clock": lambda: busy(0.2), "one": lambda: (busy(0.1), sleep(0.3))}
    time, asleep = paces(CLOCK, [ONE], lambda *_: True)["one"]
    assert 0.4 < time < 0.7 and 0.2 < asleep < 0.4


def test_a_call_gets_further_rounds_until_its_least_time_is_enough(monkeypatch, calls):
    """The clock takes 2 s at least; the call takes 8, 5, and then 6 s."""
    clock, one, asked = iter([3, 2, 4, 4]), iter([8, 5, 6]), []

    def enough(name, pace):
        asked.append((name, *pace))
        return pace.time < 3

    calls |= {"clock": lambda: next(clock), "one": lambda: next(one)}
    monkeypatch.setattr(eval.pace._Meter, "of", lambda meter, call: Pace(call(), 0.25))
    assert paces(CLOCK, [ONE], enough) == {"one": Pace(2.5, 0.25)}
    assert asked == [("one", 4.0, 0.25), ("one", 2.5, 0.25)] and next(one) == 6


def test_calls_drags_and_regions_are_timed():
    task = "hairpin around=12"
    timed = [
        Timed("call", task, "arap max_iterations=2"),
        Timed("finer", task, "fast vertices=60", level=1),
        Timed("drag", task, "fast vertices=60", drag=True),
    ]
    found = paces(timed[0], timed, lambda *_: True)
    assert list(found) == ["call", "finer", "drag_bind", "drag_steps"]
    assert all(0 < time < 100 for time, _ in found.values())
    with pytest.raises(InputError, match="call cannot be timed: .*"):
        paces(timed[0], [Timed("call", task, "paper vertices=5")], lambda *_: True)
