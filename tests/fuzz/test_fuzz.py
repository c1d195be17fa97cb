"""Give each reader up to 300 mutated inputs. The test marked `full` tries many more on the slowest reader."""

import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import TARGETS, refused_or_read

#: Numbers of mutated inputs of slow readers. Other readers get 300.
COUNTS = {"yaml": 150, "shapes": 40}


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *((name, COUNTS.get(name, 300)) for name in TARGETS),
        pytest.param("shapes", 5000, marks=pytest.mark.full),
    ],
)
def test_mutated_inputs_are_read_or_refused(name, count, tmp_path):
    target = TARGETS[name]
    seeds = target.seeds()
    assert any(refused_or_read(target, seed, tmp_path) for seed in seeds)
    read = [refused_or_read(target, mutated(seeds, target.tokens, number=k), tmp_path) for k in range(count)]
    assert 0 < sum(read) < count  # the mutations are neither all harmless nor all fatal
