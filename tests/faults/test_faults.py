"""Builds and sweeps are killed at random moments and run twice at once; runs get no memory."""

import shlex
from pathlib import Path

import pytest

from eval.rows.store import read_row, run_folders
from tests.faults.disturb import SCENES, kill_at_random, run_to_the_end, two_at_once
from tests.robustness.case import run

MANY = [pytest.param(name, 12, seed, marks=pytest.mark.full) for name in SCENES for seed in (1, 2, 3)]


@pytest.mark.parametrize(("name", "kills", "seed"), [("build", 2, 0), ("sweep", 2, 0), *MANY])
def test_after_kills_a_rerun_gives_what_an_undisturbed_run_gives(name, kills, seed, tmp_path):
    scene = SCENES[name]
    scene.prepare(tmp_path)
    expected, seconds = run_to_the_end(scene, tmp_path)
    assert expected, "it left nothing"
    kill_at_random(scene, tmp_path, kills=kills, expected=expected, seconds=seconds, seed=seed)
    codes = two_at_once(scene, tmp_path, expected=expected)
    assert codes == [0, 0] or (name != "sweep" and sorted(codes) == [0, 2])


def test_a_run_without_memory_says_so_and_the_others_go_on(here):
    configs = Path(__file__).parent / "configs"
    command = ["sshade-eval", "run", "--config-dir", str(configs), "-m", "run.fresh=true"]
    command += ["run.allow_targets=[tests.faults.]", "dataset=hairpin", "paths.runs=.", "run.folder=out"]
    code, _, err = run(shlex.join([*command, "method=hungry,killed,identity"]))
    assert code == 1 and "Traceback" not in err, err
    rows = {row["method.name"]: row for row in map(read_row, run_folders(here / "out"))}
    statuses = {name: row["status"] for name, row in rows.items()}
    assert statuses == {"hungry": "failed", "killed": "failed", "identity": "ok"}
    assert rows["hungry"]["reason"].startswith("MemoryError: Unable to allocate 1.00 GiB")
    assert "killed by signal 9" in rows["killed"]["reason"] and "memory" in rows["killed"]["reason"]
    assert rows["identity"]["peak_mib"] > 10
