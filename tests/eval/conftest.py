"""Fixtures for tests of runs. This file also makes the modules of its folder importable by the tests."""

from pathlib import Path

import pytest
from report_runs import make_runs

from eval.main import call
from eval.run.warmup import tiny_task
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """Return the CSV of a small experiment, whose run folders lie in runs/tiny beside the CSV."""
    return make_runs(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="session")
def tiny_runs(tiny) -> Path:
    """Return the folder with the run folders of the small experiment."""
    return tiny.parent / "runs" / "tiny"


@pytest.fixture(scope="session")
def tiny_report(tiny, tiny_runs) -> Path:
    """Make the report of the small experiment while its methods cannot run."""
    out = tiny.parent / "report.html"
    look = ["--towards", "1", "0", "0.2", "--up", "0", "0", "1"]
    with pytest.MonkeyPatch.context() as patch:
        for name in ("stretching", "with_options", "failing", "missing_extra"):
            patch.setattr(f"eval_cases.{name}", lambda *a, **k: pytest.fail("a report ran a method"))
        assert call("report", [str(tiny), "-o", str(out), "--runs", str(tiny_runs), *look]) == 0
    return out


@pytest.fixture
def case(here) -> str:
    """Write a sphere of 642 vertices and its handles to the current folder; return the case for commands."""
    task = tiny_task()
    write_mesh("rest.ply", task.mesh.V, task.mesh.F)
    write_handles("pose.json", task.handles)
    return "mesh mesh=rest.ply handles=pose.json"
