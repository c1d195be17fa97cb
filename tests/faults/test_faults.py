"""Builds and sweeps are killed at random moments and run twice at once."""

import pytest

from tests.faults.disturb import SCENES, kill_at_random, run_to_the_end, two_at_once

MANY = [pytest.param(name, 12, seed, marks=pytest.mark.full) for name in SCENES for seed in (1, 2, 3)]


@pytest.mark.parametrize(("name", "kills", "seed"), [("build", 2, 0), ("sweep", 1, 0), *MANY])
def test_after_kills_a_rerun_gives_what_an_undisturbed_run_gives(name, kills, seed, tmp_path):
    scene = SCENES[name]
    scene.prepare(tmp_path)
    expected, seconds = run_to_the_end(scene, tmp_path)
    assert expected, "it left nothing"
    kill_at_random(scene, tmp_path, kills=kills, expected=expected, seconds=seconds, seed=seed)
    codes = two_at_once(scene, tmp_path, expected=expected)
    assert codes == [0, 0] or (name != "sweep" and sorted(codes) == [0, 2])
