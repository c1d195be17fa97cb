"""Open3D's ARAP against this project's ARAP, its second energy, and the error without Open3D."""

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.open3d_arap import open3d_arap
from sshade.mesh.mesh import Mesh
from sshade.solver.local_global import local_global
from tests.shapes import held_ends, icosphere


@pytest.fixture
def open3d():
    return pytest.importorskip("open3d", reason="the extra open3d is not installed")


def test_it_comes_to_the_minimum_of_arap_where_no_angle_is_obtuse(open3d):
    ball = icosphere(2)
    turn = Rotation.from_euler("z", 60, degrees=True).as_matrix()
    task = held_ends(Mesh(ball.V * [1.0, 1.02, 1.05], ball.F), turn=turn)
    theirs = open3d_arap(task, iterations=500)
    ours = local_global(task, energy="spokes", tolerance=1e-9, max_iterations=5000)
    assert np.abs(theirs.vertices - ours.vertices).max() < 1e-7 * task.mesh.diagonal


def test_smoothed_is_another_energy(open3d):
    task = held_ends(icosphere(2))
    spokes, smoothed = (open3d_arap(task, energy=kind).vertices for kind in ("spokes", "smoothed"))
    assert np.abs(spokes - smoothed).max() > 1e-3
    np.testing.assert_allclose(smoothed[task.handles.index], task.handles.target, atol=1e-12)


def test_the_library_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(ModuleNotFoundError, match="open3d"):
        open3d_arap(held_ends(icosphere(1)))
