"""Fixtures for tests of runs. This file also makes the modules of its folder importable by the tests."""

from pathlib import Path

import pytest
from eval_cases import bumpy_task, run

from eval.main import call
from eval.rows.collect import collect
from eval.rows.frame import write_csv
from eval.run.warmup import tiny_task
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles

#: Packages whose methods run in the process of the tests.
OURS = ("sshade", "baselines", "eval_cases")
METHODS = {
    "arap": {"_target_": "baselines.arap.arap", "max_iterations": 5, "note": "five <iterations> & no more"},
    "learned": {"_target_": "eval_cases.with_options"},
    "stretching": {"_target_": "eval_cases.stretching", "factor": 1.5},
    "failing": {"_target_": "eval_cases.failing"},
    "missing": {"_target_": "eval_cases.missing_extra"},
}


@pytest.fixture
def in_process(monkeypatch):
    """Let methods of the tests run in this process, as methods of the project do."""
    monkeypatch.setattr("eval.run.targets.OURS", OURS)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """Run a small experiment with results, a failure and a skipped run; return the CSV of its rows.

    The rows and the run folders lie in the folder `out` where the commands put them.
    """
    out = tmp_path_factory.mktemp("tiny") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eval.run.targets.OURS", OURS)
        for angle in (10.0, 40.0):
            source = {"_target_": "eval_cases.bumpy_task", "level": 2, "angle": angle}
            for method, config in METHODS.items():
                task = bumpy_task(level=2, angle=angle)
                run(task, config, name=method, root=out / "runs" / "tiny", source=source)
    write_csv(out / "rows" / "tiny.csv", collect(out / "runs" / "tiny"))
    return out / "rows" / "tiny.csv"


@pytest.fixture(scope="session")
def tiny_report(tiny) -> Path:
    """Make the report of the small experiment while its methods cannot run."""
    look = {"towards": [1.0, 0.0, 0.2], "up": [0.0, 0.0, 1.0]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eval.publish.figures.read_picture", {"tiny": look}.get)
        for name in ("stretching", "with_options", "failing", "missing_extra"):
            patch.setattr(f"eval_cases.{name}", lambda *a, **k: pytest.fail("a report ran a method"))
        patch.chdir(tiny.parents[2])
        assert call("report", ["tiny"]) == 0
    return tiny.parents[1] / "report.html"


@pytest.fixture
def case(here) -> str:
    """Write a sphere of 642 vertices and its handles to the current folder; return the case for commands."""
    task = tiny_task()
    write_mesh("rest.ply", task.mesh.V, task.mesh.F)
    write_handles("pose.json", task.handles)
    return "mesh mesh=rest.ply handles=pose.json"
