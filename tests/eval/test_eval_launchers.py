"""A sweep gives the same rows with every installed launcher, and a lost worker is reported."""

import os

import pandas as pd
import pytest
from compositions import composed
from eval_cases import write_theirs
from eval_program import ENVIRONMENT, run_eval, run_program
from hydra.errors import HydraException

from eval.configure import app as cli
from eval.rows.collect import collect
from sshade.core.console import how_to_install
from tests.cluster.same_rows import comparable

NEEDS = {
    "joblib": "hydra_plugins.hydra_joblib_launcher",
    "slurm": "hydra_plugins.hydra_submitit_launcher",
    "submitit_local": "hydra_plugins.hydra_submitit_launcher",
    "ray": "hydra_plugins.hydra_ray_launcher",
    "ray_cluster": "hydra_plugins.hydra_ray_launcher",
}
JOBLIB = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
RUNS = ["-m", "dataset=bumpy", "method=failing,identity"]


@pytest.mark.parametrize("launcher", NEEDS)
def test_the_launcher_composes(launcher):
    pytest.importorskip(NEEDS[launcher], reason=f"the extra of hydra/launcher={launcher} is not installed")
    settings = composed(f"hydra/launcher={launcher}").hydra.launcher
    assert settings._target_.startswith(NEEDS[launcher])
    if launcher == "slurm":
        assert cli._jobs(settings, 10_000) == settings.array_parallelism > 1
    if launcher == "ray_cluster":
        assert settings.ray.init == {"address": "auto", "object_store_memory": None}


@pytest.fixture(scope="module")
def basic(tmp_path_factory):
    """Sweep over a failing and a successful run in sequence; return the ended program and the rows."""
    folder = tmp_path_factory.mktemp("basic")
    done = run_eval(folder, *RUNS)
    return done, collect(folder / "out/runs/single")


@pytest.mark.parametrize(
    ("launcher", "options"),
    [
        ("joblib", ["hydra.launcher.n_jobs=2"]),
        pytest.param("submitit_local", [], marks=pytest.mark.full),
        ("ray", ["+hydra.launcher.ray.init.num_cpus=2", "hydra.launcher.ray.init.address=local"]),
    ],
)
def test_another_launcher_gives_the_same_rows(tmp_path, basic, launcher, options):
    pytest.importorskip(NEEDS[launcher], reason=f"the extra of hydra/launcher={launcher} is not installed")
    done, rows = run_program(tmp_path, *RUNS, f"hydra/launcher={launcher}", *options), collect(tmp_path)
    assert done.returncode == basic[0].returncode == 1, done.stderr
    lines, lines_of_basic = (text.splitlines() for text in (done.stdout, basic[0].stdout))
    assert {line.split(":")[0] for line in lines} == {line.split(":")[0] for line in lines_of_basic}
    assert "[2 done, 1 failed, 0 remaining]" in lines[1]
    assert lines[2] == lines_of_basic[2] == "2 runs: 2 new (1 failed, 1 ok), 0 kept; in out/runs/single"
    pd.testing.assert_frame_equal(comparable(rows), comparable(basic[1]))
    assert rows["env.jobs"].tolist() == [2, 2]
    assert not list(tmp_path.rglob("sweep.json"))


def test_a_worker_of_other_code_ends_the_sweep(tmp_path):
    """Every new process edits the method's package first, so that no two processes load the same code."""
    pytest.importorskip(NEEDS["joblib"], reason="the extra joblib is not installed")
    path = write_theirs(tmp_path) / "helper.py"
    (tmp_path / "sitecustomize.py").write_text(
        f"with open({str(path)!r}, 'a') as file: file.write('A = 1;')\n"
    )
    method = ["method=stretching", "method._target_=theirs.method.method"]
    place = os.pathsep.join([str(tmp_path), ENVIRONMENT["PYTHONPATH"]])
    done = run_program(tmp_path, "-m", "dataset=bumpy", *method, "seed=0,1", *JOBLIB, PYTHONPATH=place)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    told = done.stderr.splitlines()[-1]  # after Hydra's message about the worker's error
    assert told.startswith("error: theirs/helper.py has changed since the command began")
    assert "Traceback" not in done.stderr and not list(tmp_path.rglob("row.json"))


def test_a_lost_worker_is_told(tmp_path):
    pytest.importorskip(NEEDS["joblib"], reason="the extra joblib is not installed")
    done = run_program(tmp_path, "-m", "dataset=bumpy", "method=dying", "seed=0,1", *JOBLIB)
    assert done.returncode == 1
    assert done.stdout == "2 runs: 0 new, 0 kept, 2 not done; in out/runs/single\n"
    told = "failed: a worker was lost (TerminatedWorkerError); the same command goes on from there"
    assert told in done.stderr.splitlines()
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("sweep.json"))


@pytest.mark.parametrize("extra", ["joblib", "slurm", "ray"])
def test_a_launcher_that_is_not_there_names_its_extra(extra):
    """The test edits Hydra's message about an unknown launcher, because our launchers may be installed."""
    with pytest.raises(HydraException) as caught:
        composed("hydra/launcher=nothing")
    assert "extra" not in cli._one_line(caught.value)
    absent = HydraException(str(caught.value).replace("launcher/nothing", f"launcher/{extra}"))
    assert cli._one_line(absent).endswith(f"To use it, {how_to_install(extra)}.")
