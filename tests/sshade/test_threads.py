import gc
import os
import subprocess
import sys
import threading

import pytest

from sshade import InputError
from sshade.core.threads import ThreadTeam, in_threads


def square(i: int) -> int:
    return i * i


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_results_come_in_order_again_and_again(workers, count):
    expected = [i * i for i in range(count)]
    with ThreadTeam(workers) as team:
        for _ in range(3):
            assert team(square, count) == expected
    assert in_threads(square, count, workers=workers) == in_threads(square, count) == expected
    with pytest.raises(InputError, match="0 workers were asked for; at least one is needed"):
        ThreadTeam(0)


def test_a_team_works_at_the_same_time():
    meet = threading.Barrier(3, timeout=20)  # passed by three threads at once, or broken
    with ThreadTeam(3) as team:
        assert sorted(team(lambda _: meet.wait(), 3)) == [0, 1, 2]


@pytest.mark.parametrize("workers", [1, 3])
def test_the_first_error_in_order_is_raised_and_the_rest_dropped(workers):
    meet, begun = threading.Barrier(workers, timeout=20), []

    def chunk(i: int) -> None:
        begun.append(i)
        if i < workers:
            meet.wait()
        raise ValueError(f"chunk {i}")

    with ThreadTeam(workers) as team:
        with pytest.raises(ValueError, match="chunk 0"):
            team(chunk, 50)
        assert len(begun) <= 2 * workers
        assert team(square, 3) == [0, 1, 4]


def test_threads_end_with_their_team():
    team, own = ThreadTeam(3), set()
    barrier = threading.Barrier(3, timeout=10)

    def meet(_: int) -> None:
        own.add(threading.current_thread())
        barrier.wait()

    team(meet, 3)
    others = own - {threading.current_thread()}
    assert len(others) == 2 and all(thread.is_alive() for thread in others)
    del team
    gc.collect()
    for thread in others:
        thread.join(timeout=10)
        assert not thread.is_alive()


FORK = """
import os, signal
from sshade.core.threads import ThreadTeam

def square(i):
    return i * i

with ThreadTeam(3) as team:
    team(square, 3)
    if not (child := os.fork()):
        signal.alarm(120)  # ends a child that waits for threads of its parent
        os._exit(team(square, 3) != [0, 1, 4])
    assert os.waitpid(child, 0)[1] == 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_team_works_after_a_fork():
    subprocess.run([sys.executable, "-W", "ignore", "-c", FORK], check=True)
