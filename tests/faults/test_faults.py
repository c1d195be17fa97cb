"""A few kills of a build and of a sweep, and runs without memory; ``python -m tests.faults`` kills more."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from eval.rows.store import read_row, run_folders
from tests.faults.disturb import kill_at_random, two_at_once, undisturbed
from tests.faults.scenes import ROOT, SCENES


@pytest.mark.parametrize(("name", "kills"), [("build", 2), ("sweep", 3)])
def test_after_kills_a_rerun_gives_what_an_undisturbed_run_gives(name, kills, tmp_path):
    scene = SCENES[name]
    expected, seconds = undisturbed(scene, tmp_path)
    kill_at_random(scene, tmp_path, kills=kills, expected=expected, seconds=seconds)
    codes = two_at_once(scene, tmp_path, expected=expected)
    assert codes == [0, 0] or (name != "sweep" and sorted(codes) == [0, 2])


def test_a_run_without_memory_says_so_and_the_others_go_on(tmp_path):
    configs = Path(__file__).parent / "configs"
    command = [sys.executable, "-m", "eval", "--config-dir", str(configs), "-m", "run.fresh=true"]
    command += ["run.allow_targets=[tests.faults.]", "dataset=hairpin", "paths.runs=.", "run.folder=out"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*command, "method=hungry,killed,identity"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    rows = {row["method.name"]: row for row in map(read_row, run_folders(tmp_path / "out"))}
    assert {name: row["status"] for name, row in rows.items()} == {
        "hungry": "failed",
        "killed": "failed",
        "identity": "ok",
    }
    assert rows["hungry"]["reason"].startswith("MemoryError: Unable to allocate 1.00 GiB")
    assert rows["killed"]["reason"] == (
        "the process was killed by signal 9; the system does this when memory runs out"
    )
    assert rows["identity"]["peak_mib"] > 10
