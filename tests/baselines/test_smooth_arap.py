"""Smooth ARAP against results of its authors' program, and against ARAP."""

from pathlib import Path

import numpy as np
import pytest

from baselines.accelerated import local_global
from baselines.smooth_arap import smooth_arap
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, Handles
from tests.shapes import bumpy, held_ends

ORACLES = sorted(Path(__file__).parent.glob("oracles/smooth_arap_*.npz"))


@pytest.mark.parametrize("path", ORACLES, ids=lambda path: path.stem)
def test_converges_to_the_result_of_the_authors_program(path):
    with np.load(path) as file:
        mesh, handles = Mesh(file["V"], file["F"].astype(int)), Handles(file["handles"], file["targets"])
        smoothness, expected = float(file["smoothness"]), file["converged"]
    ours = smooth_arap(DeformationTask("oracle", mesh, handles), smoothness=smoothness, tolerance=1e-10)
    assert ours.converged
    assert np.abs(ours.vertices - expected).max() < 1e-6 * mesh.diagonal


def test_without_smoothness_it_is_arap_with_spokes_and_rims():
    task = held_ends(bumpy(2))
    assert (smooth_arap(task, max_iterations=0).extra["rotations"] == np.eye(3)).all()
    task = DeformationTask("guess", task.mesh, task.handles, guess=task.mesh.V)  # rotations are fitted first
    ours = smooth_arap(task, smoothness=0.0, tolerance=0, max_iterations=25)
    arap = local_global(task, accelerate=False, tolerance=0, max_iterations=25)
    assert np.abs(ours.vertices - arap.vertices).max() < 1e-11 * task.mesh.diagonal
