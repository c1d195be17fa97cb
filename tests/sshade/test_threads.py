"""Threads: teams, errors, and the same bits from one range of rows and from many."""

import gc
import os
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.core.threads import ThreadTeam, in_ranges, in_threads
from sshade.mesh.faces import connectivity
from sshade.proxy.binding import bind_proxy
from sshade.proxy.blended import BlendedFrames
from sshade.proxy.sample import proxy_mesh, sample_proxy
from tests.shapes import double_torus, icosphere, jittered, tube
from tests.sshade.mesh.test_connectivity import CASES


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


def test_a_waiting_team_holds_nothing_of_its_last_work():
    meet, freed, held = threading.Barrier(2, timeout=20), threading.Event(), threading.Thread()
    weakref.finalize(held, freed.set)
    with ThreadTeam(2) as team:
        team(lambda _, held=held: bool(held) and meet.wait() < 0, 2)  # both threads take part
        del held
        assert freed.wait(20)


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
        time.sleep(0.05 * (i == 0))  # it fails last
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


MESHES = [jittered(icosphere(3), 0.02), jittered(double_torus(cells=3), 0.01), jittered(tube(12, 20), 0.02)]


@pytest.fixture
def many(monkeypatch):
    """A function after which ranges are of seven rows, in three threads."""

    def split() -> None:
        monkeypatch.setattr("sshade.core.threads.CHUNK", 7)
        monkeypatch.setattr("sshade.mesh.faces.FACES", 5)
        for module in ("sshade.core.threads", "sshade.mesh.faces"):
            monkeypatch.setattr(f"{module}.available_cpus", lambda: 3)

    return split


def arrays(value: object) -> list[np.ndarray]:
    """All arrays and numbers of a nested tuple or of an object."""
    if isinstance(value, tuple):
        return [array for part in value for array in arrays(part)]
    return [np.asarray(value)] if not hasattr(value, "__dict__") else arrays(tuple(vars(value).values()))


def assert_same_bits(one: object, other: object) -> None:
    for a, b in zip(arrays(one), arrays(other), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)


@pytest.mark.parametrize("n", [0, 1, 6, 7, 8, 50])
def test_ranges_cover_all_rows_in_order(many, n):
    many()
    ranges = in_ranges(lambda first, end: list(range(first, end)), n)
    assert sum(ranges, []) == list(range(n)) and all(len(rows) <= 7 for rows in ranges)


@pytest.mark.parametrize("case", range(len(CASES)))
def test_connectivity_of_soups_and_shapes(many, case):
    one = connectivity(*CASES[case])
    many()
    assert_same_bits(connectivity(*CASES[case]), one)


@pytest.mark.parametrize("shape", range(len(MESHES)))
def test_a_proxy_and_what_is_bound_to_it(many, shape):
    def bound() -> object:
        mesh = Mesh(MESHES[shape].V, MESHES[shape].F)  # which remembers nothing
        sampling = sample_proxy(mesh, 60, seed=3)
        binding = bind_proxy(mesh, sampling, frames=lambda proxy, _: BlendedFrames(proxy))
        bent = proxy_mesh(mesh, sampling).V * [1.0, 1.2, 0.9] + np.sin(binding.proxy.V[:, [1, 2, 0]])
        return sampling, binding.projection, binding.local, binding.carry(bent)

    one = bound()
    many()
    assert_same_bits(bound(), one)
