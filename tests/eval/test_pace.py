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
    monkeypatch.setattr(Timed, "calls", lambda one: [told[name] for name in one.names])
    return told


CLOCK, ONE = (Timed(name, "", "") for name in ("clock", "one"))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the states of threads")
def test_work_and_sleep_are_told_apart(calls):
    calls |= {"clock": lambda: busy(0.2), "one": lambda: (busy(0.1), sleep(0.3))}
    time, asleep = paces(CLOCK, [ONE], lambda *_: True)["one"]
    assert 0.4 < time < 0.7 and 0.2 < asleep < 0.4


def test_a_drag_gets_further_rounds_until_both_its_least_times_are_enough(monkeypatch, calls):
    """The clock takes 2 s at least; slow parts take 8 and then 5 s, and nothing is called again."""
    slow, fast = [8, 5], [3, 4]
    seconds = {"a_bind": slow, "a_steps": fast, "b_bind": fast, "b_steps": slow}
    seconds |= {"clock": [3, 2, 4, 4], "one": [3]}
    calls |= {name: iter(told).__next__ for name, told in seconds.items()}
    monkeypatch.setattr(eval.pace._Meter, "of", lambda meter, call: Pace(call(), 0.25))
    drags = [Timed(name, "", "", drag=True) for name in "ab"]
    found = paces(CLOCK, [ONE, *drags], lambda name, pace: pace.time < 3)
    times = {name: 2.5 if seconds[name] is slow else 1.5 for name in found}
    assert found == {name: Pace(times[name], 0.25) for name in ("one", *drags[0].names, *drags[1].names)}


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
