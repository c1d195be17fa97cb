"""The example: a body that can be deformed at once, made without the libraries of the benchmark."""

import subprocess
import sys

import numpy as np
import pytest

import sshade
from defaust.example import POSES
from sshade import DeformationTask, Mesh, read_handles

BENCHMARK = ["hydra", "igl", "omegaconf", "pandas", "pymeshlab", "trimesh"]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The folder of an example of 27,554 vertices, written without the libraries of the benchmark."""
    root = tmp_path_factory.mktemp("example")
    code = f"import sys; sys.modules |= dict.fromkeys({BENCHMARK}); from defaust.cli import main; main()"
    command = [sys.executable, "-c", code, "example", "my body", "--subdivisions", "1"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=True)
    assert done.stdout == (
        "my body/rest.ply: 27,554 vertices; "
        "try: sshade deform 'my body/rest.ply' 'my body/pose_6.json' -o posed.ply\n"
    )
    return root / "my body"


@pytest.mark.parametrize(("pose", "farthest"), [*zip(POSES, (1.0, 1.0, 3.0), strict=True)])
def test_a_deformed_example_is_near_its_true_pose(example, pose, farthest):
    rest = Mesh(*sshade.read(example / "rest.ply"))
    truth = sshade.read(example / f"pose_{pose}_true.ply").V
    handles = read_handles(example / f"pose_{pose}.json", rest)
    assert rest.is_closed and rest.is_oriented and 0.05 < rest.volume < 0.1
    assert len(handles.index) == 210 and handles.dynamic.any() and not handles.dynamic.all()
    moving = handles.dynamic
    np.testing.assert_allclose(handles.target[moving], truth[handles.index[moving]], atol=1e-9)
    U = sshade.deform(DeformationTask("example", rest, handles), vertices=1500).vertices
    distance = 100 * np.linalg.norm(U - truth, axis=1).mean() / rest.diagonal
    assert distance < farthest < 100 * np.linalg.norm(rest.V - truth, axis=1).mean() / rest.diagonal
