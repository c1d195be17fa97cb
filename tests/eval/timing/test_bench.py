"""The benchmark command on a small mesh: it runs, and says what it promises."""

import re

import pytest

from eval.main import call
from eval.run.warmup import tiny_task
from eval.timing.scaling import scaling
from eval.timing.timing import take_turns
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder, task = tmp_path_factory.mktemp("bench"), tiny_task()
    write_mesh(folder / "rest.ply", task.mesh.V, task.mesh.F)
    write_handles(folder / "pose.json", task.handles)
    return folder / "rest.ply", folder / "pose.json"


def test_every_section_prints_its_figures(files, capsys):
    small = ["--vertices", "150", "--samplings", "2", "1", "--repeats", "1", "--block", "2", "--full"]
    assert call("bench", [*map(str, files), *small]) == 0
    printed = capsys.readouterr().out
    for pattern in (
        r"elastic \(libigl\): precomputation .* extrapolated from 1 x 2",
        r"sshade, 2 samplings: .* faster than 1000 iterations",
        r"sshade, 1 sampling: .* faster than 1000 iterations",
        r"remesh \(one thread\): .* iterations of elastic",
        r"Cholesky factorisation: superlu .* of that",
        r"warm start moves the result by",
        r"elastic, (stopping rule|1000 iterations): .* residual",
        r"warm cache: \d",
        r"deformations a second",
        r"released and solved to a residual of",
    ):
        assert re.search(pattern, printed), pattern


def test_scaling_measures_the_nearest_subdivisions(files, tmp_path, capsys):
    plot = tmp_path / "plots/scaling.svg"
    scaling([files[0]], files[1], vertices=150, repeats=1, sizes=(600, 2500, 2600), plot=plot)
    lines = capsys.readouterr().out.splitlines()
    sizes = [int(line.split()[0]) for line in lines[1:3]]
    assert sizes == [642, 2562]  # two of the wanted sizes share one
    assert "log-log slope" in lines[3]
    assert plot.stat().st_size > 0


def test_runs_take_turns():
    order = []
    timings = take_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 3
    assert [len(timing.seconds) for timing in timings.values()] == [3, 3]
