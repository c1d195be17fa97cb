"""A sweep gives the same rows with every installed launcher, and a lost worker is reported."""

import pandas as pd
import pytest
from eval_program import run_eval, run_program

from eval.rows.collect import collect
from tests.cluster.same_rows import comparable

LOST = "failed: a worker was lost (TerminatedWorkerError); the same command goes on from there"
RUNS = ["-m", "dataset=bumpy", "method=failing,identity"]


@pytest.fixture(scope="module")
def basic(tmp_path_factory):
    """Sweep over a failing and a successful run in sequence; return the ended program and the rows."""
    folder = tmp_path_factory.mktemp("basic")
    done = run_eval(folder, *RUNS)
    return done, collect(folder / "out/runs/single")


@pytest.mark.full
@pytest.mark.parametrize(
    ("launcher", "options"),
    [
        ("joblib", ["hydra.launcher.n_jobs=2"]),
        ("submitit_local", []),
        ("ray", ["+hydra.launcher.ray.init.num_cpus=2", "hydra.launcher.ray.init.address=local"]),
    ],
)
def test_another_launcher_gives_the_same_rows(tmp_path, basic, launcher, options):
    pytest.importorskip(
        f"hydra_plugins.hydra_{launcher[:8].rstrip('_')}_launcher",
        reason=f"the extra of hydra/launcher={launcher} is not installed",
    )
    done, rows = run_program(tmp_path, *RUNS, f"hydra/launcher={launcher}", *options), collect(tmp_path)
    assert done.returncode == basic[0].returncode == 1, done.stderr
    lines, lines_of_basic = (text.splitlines() for text in (done.stdout, basic[0].stdout))
    begins = ["[1/2] failing on bumpy_30", "[2/2] identity on bumpy_30"]
    for own in (lines, lines_of_basic):
        assert sorted(line.split(":")[0] for line in own) == begins
    pd.testing.assert_frame_equal(comparable(rows), comparable(basic[1]))
    assert rows["env.jobs"].tolist() == [2, 2]


def test_a_lost_worker_is_told_in_one_line(tmp_path, monkeypatch):
    executor = pytest.importorskip("joblib.externals.loky.process_executor")

    def lost(*_, **__):
        raise executor.TerminatedWorkerError("a long story")

    monkeypatch.setattr("eval.run.app._run_hydra", lost)
    done = run_eval(tmp_path, "-m", "dataset=bumpy", "method=identity")
    assert (done.returncode, done.stderr) == (1, f"{LOST}\n")
