"""Jobs take turns. A disturbed repeat is rejected and run again; too many rejections end the command."""

from time import sleep

import pytest

from eval.bench.turns import ATTEMPTS, Job, Reading, take_turns, used_by_others
from sshade import InputError


def job(name, order):
    def call():
        order.append(name)
        sleep(2e-3)
        return {"seconds.total": 1.0}

    return Job({"method.name": name, "method.hash": name, "task.name": "t", "task.checksum": "c"}, call)


def test_several_rejected_repeats_in_a_row_end_the_command(machine):
    machine(0.3)
    order = []
    with pytest.raises(InputError, match="not quiet: 5 repeats of a on t in a row .* used 30% .*nothing was"):
        take_turns([job("a", order)], rounds=3)
    assert order == ["a"] * (1 + ATTEMPTS)


@pytest.mark.parametrize(("busy", "own", "share"), [(19.0, 18.1, 0.045), (19.0, 17.8, 0.06), (5.0, 5.1, 0.0)])
def test_the_share_of_others(busy, own, share):
    """The system counts whole ticks, so it may count less than the process."""
    before, after = Reading(100.0, 50.0, 40.0), Reading(110.0, 50 + busy, 40 + own)
    assert used_by_others(before, after, cores=2) == pytest.approx(share)
