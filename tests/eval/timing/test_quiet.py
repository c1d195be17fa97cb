"""The load of other processes and jumps of the clock are noticed, and the busiest process is found."""

import os
import re
import subprocess
import sys
from contextlib import suppress
from math import ceil

import psutil
import pytest

from eval.timing import quiet
from eval.timing.quiet import OTHERS, Reading, between, busiest_other, read_machine

BURN = "import time\nend = time.time() + 60\nwhile time.time() < end: pass"


@pytest.mark.parametrize(
    ("seconds", "clock", "busy", "own", "problem"),
    [
        (10.0, 10.0, 19.0, 18.1, ""),
        (10.0, 10.0, 19.0, 17.8, "other processes used 6% of the machine's 2 cores"),
        (10.0, 10.0, 5.0, 5.1, ""),  # the system counts whole ticks, so less than the process
        (10.0, 10.05, 5.0, 5.0, ""),
        (10.0, 3610.0, 5.0, 5.0, "the clock jumped by +3600.0 s"),
        (10.0, 5.0, 5.0, 5.0, "the clock jumped by -5.0 s"),
    ],
)
def test_what_makes_a_span_count(seconds, clock, busy, own, problem):
    use = between(
        Reading(100.0, 7.0, 50.0, 40.0), Reading(100 + seconds, 7 + clock, 50 + busy, 40 + own), cores=2
    )
    assert use.problem == problem
    assert use.seconds == seconds and use.cores_used == pytest.approx(own / seconds)
    assert use.others == pytest.approx(max(0, busy - own) / 20)


def test_what_counts_as_busy(monkeypatch):
    """Idle time and waits for a disk do not count. Time of a hypervisor counts. `user` includes guests."""
    from collections import namedtuple

    names = "user nice system idle iowait irq softirq steal guest guest_nice"
    times = namedtuple("times", names)(1, 2, 4, 1000, 500, 8, 16, 32, 1, 2)
    monkeypatch.setattr(quiet.psutil, "cpu_times", lambda: times)
    assert read_machine().busy == 1 + 2 + 4 + 8 + 16 + 32


def test_children_are_own_while_they_run_and_after():
    work = "import time\nwhile time.process_time() < 0.4: pass\nprint(flush=True)\ninput()"
    begin = read_machine()
    with subprocess.Popen(
        [sys.executable, "-c", work], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        child.stdout.readline()
        living = read_machine()
        child.communicate(b"\n")
    ended = read_machine()
    assert living.own - begin.own >= 0.35  # the system rounds to ticks of 10 ms
    assert ended.own >= living.own - 0.02
    assert living.busy - begin.busy >= 0.3


@pytest.fixture
def busy():
    """Start busy processes on at least a tenth of the cores; their parent ends. Yield their pids."""
    count = ceil(2 * OTHERS * os.cpu_count())
    script = f'for i in $(seq {count}); do "$0" -c "$1" >/dev/null 2>&1 & echo $!; done'
    shell = ["sh", "-c", script, sys.executable, BURN]
    pids = [int(pid) for pid in subprocess.run(shell, check=True, capture_output=True).stdout.split()]
    yield pids
    for pid in pids:
        with suppress(psutil.NoSuchProcess):  # the process ends by itself after a minute
            psutil.Process(pid).kill()


def test_the_busiest_process_is_told(busy):
    assert re.fullmatch(r"process \d+ \(.+\) with \d+% of a core", busiest_other())
