from __future__ import annotations

import threading

import pytest

from sshade import InputError
from sshade.threads import Crew, in_threads


def square(i: int) -> int:
    return i * i


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_a_crew_returns_results_in_order_again_and_again(workers, count):
    with Crew(workers) as crew:
        for _ in range(3):
            assert crew(square, count) == [i * i for i in range(count)]


def test_a_crew_works_at_the_same_time():
    meet = threading.Barrier(3, timeout=20)  # passed by three threads at once, or broken
    with Crew(3) as crew:
        assert sorted(crew(lambda _: meet.wait(), 3)) == [0, 1, 2]


@pytest.mark.parametrize("workers", [1, 3])
def test_a_crew_raises_the_error_of_a_piece_once_all_are_done(workers):
    done = []

    def piece(i: int) -> None:
        if i == 1:
            raise ValueError("piece 1")
        done.append(i)

    with Crew(workers) as crew:
        with pytest.raises(ValueError, match="piece 1"):
            crew(piece, 3)
        assert crew(square, 3) == [0, 1, 4]
    if workers == 3:
        assert sorted(done) == [0, 2]


@pytest.mark.parametrize("make", [Crew, lambda workers: in_threads(square, 3, workers=workers)])
def test_no_workers_are_an_error(make):
    with pytest.raises(InputError, match="0 workers were asked for; at least one is needed"):
        make(0)
