"""A sweep through each launcher whose extra is installed: the same rows, and a lost worker."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from eval import cli
from eval.collect import collect
from eval.compare_rows import differences

HERE = Path(__file__).parent
NEEDS = {
    "joblib": "hydra_plugins.hydra_joblib_launcher",
    "slurm": "hydra_plugins.hydra_submitit_launcher",
    "submitit_local": "hydra_plugins.hydra_submitit_launcher",
    "ray": "hydra_plugins.hydra_ray_launcher",
    "ray_cluster": "hydra_plugins.hydra_ray_launcher",
}


def sweep(folder, *overrides):
    environment = {**os.environ, "PYTHONPATH": str(HERE)}
    command = [sys.executable, "-m", "eval", "--config-dir", str(HERE / "extra_conf"), "-m", "dataset=bumpy"]
    return subprocess.run(
        [*command, *overrides], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.mark.parametrize("launcher", NEEDS)
def test_the_launcher_composes(launcher):
    pytest.importorskip(NEEDS[launcher], reason=f"the extra of hydra/launcher={launcher} is not installed")
    with initialize_config_module("conf", version_base="1.3"):
        config = compose("config", overrides=[f"hydra/launcher={launcher}"], return_hydra_config=True)
    settings = config.hydra.launcher
    assert settings._target_.startswith(NEEDS[launcher])
    if launcher == "slurm":
        assert cli._jobs(settings) == settings.array_parallelism > 1
        assert OmegaConf.to_container(settings, resolve=False)["submitit_folder"].startswith("${hydra.sweep")
    if launcher == "ray_cluster":
        assert settings.ray.init == {"address": "auto", "object_store_memory": None}


@pytest.mark.parametrize(
    ("launcher", "options", "jobs"),
    [
        ("joblib", ["hydra.launcher.n_jobs=2"], 2),
        ("submitit_local", [], 1),
        ("ray", ["+hydra.launcher.ray.init.num_cpus=2", "hydra.launcher.ray.init.address=local"], 2),
    ],
)
def test_another_launcher_gives_the_same_rows(tmp_path, launcher, options, jobs):
    pytest.importorskip(NEEDS[launcher], reason=f"the extra of hydra/launcher={launcher} is not installed")
    overrides = ["method=failing,sshade", "proxy.vertices=100", "seed=0,1"]
    basic = sweep(tmp_path, *overrides, "run.experiment=basic")
    other = sweep(tmp_path, *overrides, "run.experiment=other", f"hydra/launcher={launcher}", *options)
    assert basic.returncode == other.returncode == 1, other.stderr
    lines = other.stdout.splitlines()
    assert sorted(line.split(":")[0] for line in lines[:-1]) == sorted(
        line.split(":")[0] for line in basic.stdout.splitlines()[:-1]
    )
    assert "[4 done, 2 failed, 0 remaining]" in lines[-2]
    assert lines[-1] == basic.stdout.splitlines()[-1] == "4 runs: 4 new (2 failed, 2 ok), 0 kept"
    first, second = (collect(tmp_path / "results/runs" / name) for name in ("basic", "other"))
    assert differences(first, second) == []
    assert {(row["env.jobs"], row["env.concurrent"]) for row in second} == {(jobs, jobs > 1)}
    assert not list(tmp_path.rglob(".sweeps"))


def test_a_lost_worker_is_told_and_the_rest_can_be_run(tmp_path):
    pytest.importorskip(NEEDS["joblib"], reason="the extra joblib is not installed")
    options = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "seed=0,1"]
    done = sweep(tmp_path, "method=dying", *options)
    assert done.returncode == 1
    assert done.stdout == "2 runs: 0 new, 0 kept, 2 not done\n"
    assert "failed: a worker was lost (TerminatedWorkerError); the same command runs what is missing" in (
        done.stderr
    )
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob(".sweeps"))
    assert sweep(tmp_path, "method=dying", "run.fresh=true", *options).stdout.splitlines()[-1] == (
        "2 runs: 2 new (2 failed), 0 kept"
    )


def test_a_launcher_that_is_not_there_names_its_extra(tmp_path, monkeypatch):
    absent = [name for name in NEEDS if name in ("joblib", "ray", "slurm")]
    for name in absent:
        error = RuntimeError(f"In 'hydra/config': Could not find 'hydra/launcher/{name}' Available options")
        assert cli._one_line(error).endswith(f"It needs: pip install 'sshade[{name}]'.")
