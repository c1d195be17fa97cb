"""One property of every parser: it reads mutated bytes, or refuses them in one sentence."""

import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import TARGETS, refused_or_read

#: Numbers of mutated inputs of slow readers. Other readers get 300.
COUNTS = {"yaml": 150, "shapes": 40}


@pytest.mark.parametrize("name", TARGETS)
def test_mutated_inputs_are_read_or_refused(name, tmp_path):
    target, count = TARGETS[name], COUNTS.get(name, 300)
    seeds = target.seeds()
    assert any(refused_or_read(target, seed, tmp_path) for seed in seeds)
    read = [refused_or_read(target, mutated(seeds, target.tokens, number=k), tmp_path) for k in range(count)]
    assert 0 < sum(read) < count  # the mutations are neither all harmless nor all fatal
