"""Fixtures of tests of runs. This file also puts this folder on the path of the tests below."""

from pathlib import Path

import pytest
from report_runs import make_runs

from eval.run.warmup import tiny_task
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """Return the CSV of a small experiment, whose run folders lie in runs/tiny beside the CSV."""
    return make_runs(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="session")
def tiny_runs(tiny) -> Path:
    """The run folders of the small experiment."""
    return tiny.parent / "runs" / "tiny"


@pytest.fixture
def case(here) -> str:
    """A sphere of 642 vertices in the current folder, as a case of the command."""
    task = tiny_task()
    write_mesh("rest.ply", task.mesh.V, task.mesh.F)
    write_handles("pose.json", task.handles)
    return "mesh mesh=rest.ply handles=pose.json"
