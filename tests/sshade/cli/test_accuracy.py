"""Messages of `sshade deform` about handles that miss their targets, and about rounded positions."""

import re

import numpy as np
import pytest

from sshade import Handles
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from tests.robustness.inputs import BODY, pose

POSE = pose(BODY.V)
FAR = 1e5 * BODY.diagonal * np.array([1, 0.5, -0.7])


@pytest.fixture
def run(sound, capsys):
    """Deform a mesh file of the folder; return what is said."""

    def run(output: str, *options: str, mesh: str = "body.ply", handles: Handles = POSE) -> str:
        write_handles("pose.json", handles)
        assert main(["deform", mesh, "pose.json", "-o", output, "--vertices", "60", *options]) == 0
        return capsys.readouterr().err

    return run


def said_to_be_reached(err: str) -> float:
    """Return the fraction of the diagonal in the summary."""
    found = re.search(r"handles at most (\S+) % of the diagonal from target, ", err)
    assert found or "handles on target, " in err
    return float(found[1]) / 100 if found else 0.0


def largest_error(path: str, handles: Handles, diagonal: float) -> float:
    distance = np.linalg.norm(read_arrays(path)[0][handles.index] - handles.target, axis=1)
    return distance.max() / diagonal


@pytest.mark.parametrize("method", ["paper", "fine", "fast --volume 0 --area 0"])
def test_hard_handles_that_miss_are_a_warning(run, method):
    err = run("out.ply", "--method", *method.split())
    error = largest_error("out.ply", POSE, BODY.diagonal)
    assert said_to_be_reached(err) == pytest.approx(error, rel=0.06, abs=1e-6)
    if method == "paper":
        assert error > 1e-4
        percent = f"{100 * error:.2g}"
        assert f"warning: a handle is {percent} % of the diagonal away from its target; --method fast" in err
    else:
        assert error < 1e-9 and "warning" not in err


def test_soft_handles_are_counted_apart_and_are_no_warning(run):
    weight = np.where(np.arange(len(POSE)) < 3, 0.5, np.inf)
    target = POSE.target + 0.1 * weight[:, None].clip(max=1)
    err = run("out.ply", handles=Handles(POSE.index, target, weight=weight))
    assert f"{len(POSE) - 3} handles on target, 3 soft handles " in err and "warning" not in err
    err = run("out.ply", "--weight", "1")
    assert f"out.ply: {BODY.n} vertices, {len(POSE)} soft handles " in err


def test_far_from_the_origin_the_distance_is_that_of_the_stored_positions(run):
    """The mesh is in double precision; glTF rounds it to steps of about 1 % of the diagonal."""
    write_mesh("body.ply", BODY.V + FAR, BODY.F)
    far = Handles(POSE.index, POSE.target + FAR)
    err = run("out.obj", handles=far)
    assert said_to_be_reached(err) < 1e-9 and "single precision" not in err
    err = run("out.glb", handles=far)
    reached = largest_error("out.glb", far, BODY.diagonal)
    assert said_to_be_reached(err) == pytest.approx(reached, rel=0.06) and reached > 1e-3
    assert "note: out.glb stores single precision, which moves positions by up to" in err
    assert "warning" not in err  # the method is exact; only the format rounds
