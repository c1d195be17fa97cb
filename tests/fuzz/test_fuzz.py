"""A few hundred mutated inputs for each reader; ``python -m tests.fuzz`` tries many more, by coverage."""

from __future__ import annotations

import pytest

from sshade import InputError
from tests.fuzz.mutate import mutated
from tests.fuzz.native import fuzz_native
from tests.fuzz.targets import TARGETS, Target, refused_or_read

#: Slower ones get fewer.
COUNTS = {"map": 60, "yaml": 150}


@pytest.mark.parametrize("name", TARGETS)
def test_mutated_inputs_are_read_or_refused(name, tmp_path):
    target = TARGETS[name]
    seeds = target.seeds()
    count = COUNTS.get(name, 300)
    read = [refused_or_read(target, mutated(seeds, target.tokens, number=k), tmp_path) for k in range(count)]
    assert 0 < sum(read) < count  # some of both: the mutations are neither all harmless nor all fatal


@pytest.mark.parametrize("name", TARGETS)
def test_the_seeds_reach_the_end_of_a_reader(name, tmp_path):
    target = TARGETS[name]
    assert any(refused_or_read(target, seed, tmp_path) for seed in target.seeds())


def test_files_for_compiled_readers(tmp_path):
    assert fuzz_native(24, seed=7, crashes=tmp_path) == 0
    assert not list(tmp_path.iterdir())


def test_what_is_no_input_error_comes_through(tmp_path):
    def fail(data, folder):
        raise KeyError("x")

    def explain(data, folder):
        raise InputError("two\nlines")

    with pytest.raises(KeyError):
        refused_or_read(Target(fail, list, ()), b"", tmp_path)
    with pytest.raises(AssertionError, match="more than a line"):
        refused_or_read(Target(explain, list, ()), b"", tmp_path)


def test_mutations_repeat_by_their_number():
    seeds = [b"abcdef" * 20, b"123456" * 20]
    found = [mutated(seeds, (b"token",), number=k) for k in range(50)]
    assert found == [mutated(seeds, (b"token",), number=k) for k in range(50)]
    assert len(set(found)) > 45
