"""Jobs take turns. A disturbed repeat is rejected and run again; too many rejections end the command."""

from time import sleep

import pytest

import eval.timing.turns
from eval.timing.turns import ATTEMPTS, Job, take_turns
from sshade.core.errors import InputError


def job(name, order, seconds=(1.0,), task="t"):
    told = iter(seconds * 1000)

    def call():
        order.append(name)
        sleep(2e-3)
        return {"seconds.total": next(told), "seconds.solve": 0.5, "iterations": 7.0}

    facts = {"method.name": name, "method.hash": name, "task.name": task, "task.checksum": "c"}
    return Job(facts, call)


def test_jobs_take_turns_after_a_warm_up(machine):
    order = []
    rows = take_turns([job(name, order) for name in "abc"], rounds=3)
    assert order == list("abc") * 4
    found = [(row["method.name"], row["round"], row["repeat"]) for row in rows]
    assert found == [(name, number, number) for number in (1, 2, 3) for name in "abc"]
    assert all(row["kept"] and row["reason"] == "" and row["other_cores"] == 0 for row in rows)


def test_tasks_with_equal_arrays_count_their_own_repeats(machine):
    rows = take_turns([job("a", [], task=task) for task in "tu"], rounds=2)
    assert [(row["task.name"], row["repeat"]) for row in rows] == [("t", 1), ("u", 1), ("t", 2), ("u", 2)]


def test_short_calls_are_repeated_and_averaged(machine, monkeypatch):
    monkeypatch.setattr(eval.timing.turns, "SHORTEST", 0.05)
    order = []
    (row,) = take_turns([job("a", order, seconds=(1.0, 2.0))], rounds=1)
    assert row["calls"] == len(order) - 1 > 5  # the warm-up is one call
    assert row["seconds.repeat"] >= 0.05
    mean = (row["calls"] // 2 * 3 + row["calls"] % 2 * 2) / row["calls"]
    assert row["seconds.total"] == pytest.approx(mean) and row["seconds.solve"] == 0.5


def test_a_disturbed_repeat_is_rejected_and_repeated(machine):
    machine(0.0, 0.0, 0.2, 0.3, 0.0)  # quiet warm-ups of a and b; two rejected repeats of a; then quiet
    order = []
    rows = take_turns([job(name, order) for name in "ab"], rounds=1)
    assert order == list("abaaab")
    assert [row["method.name"] for row in rows] == list("aaab")
    assert [row["repeat"] for row in rows] == [1, 2, 3, 1]
    assert [row["kept"] for row in rows] == [False, False, True, True]
    assert rows[0]["reason"].startswith("other processes used 20% of the machine's")
    assert rows[0]["other_cores"] == pytest.approx(0.2, abs=0.01)


def test_several_rejected_repeats_in_a_row_end_the_command(machine, monkeypatch):
    monkeypatch.setattr(eval.timing.turns, "busiest_other", lambda: "process 7 (x) with 90% of a core")
    machine(0.3)
    order = []
    with pytest.raises(InputError, match="not quiet: 5 repeats of a on t in a row .* used 30% .* process 7"):
        take_turns([job("a", order)], rounds=3)
    assert order == ["a"] * (1 + ATTEMPTS)


def test_a_long_job_runs_once_unless_it_was_disturbed(machine, monkeypatch):
    monkeypatch.setattr(eval.timing.turns, "LONG", 0.0)
    order = []
    rows = take_turns([job(name, order) for name in "ab"], rounds=3)
    assert order == ["a", "b"] and [row["repeat"] for row in rows] == [1, 1]
    machine(0.2, 0.0)
    assert [row["kept"] for row in take_turns([job("a", [])], rounds=3)] == [False, True]
