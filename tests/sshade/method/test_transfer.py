"""Isometric reconstruction and pose transfer."""

import numpy as np
import pytest

from sshade import bind, transfer_pose
from tests.shapes import bent, bumpy, rotation
from tests.sshade.mesh.test_cutting import moebius, t_fin

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def mesh():
    return bumpy(4)


@pytest.mark.parametrize("mesh", [bumpy(4), t_fin(), moebius(60)])
def test_a_rigid_pose_is_exact_for_the_shape_and_its_edit(mesh):
    R, t = rotation(3), np.array([1.0, -2, 0.5])
    edited = mesh.V * [1, 1.2, 1] + 0.05 * np.sin(5 * mesh.V)
    posed = mesh.V @ R.T + t
    result = transfer_pose(mesh, posed, edited, vertices=50, samplings=2)
    assert np.abs(result.vertices - (edited @ R.T + t)).max() < ROUNDING * mesh.diagonal


def test_only_the_rows_of_samples_are_used(mesh):
    posed = bent(mesh.V)
    samples = bind(mesh, 200, seed=(7, 0)).sampling.samples
    blind = np.zeros_like(posed)
    blind[samples] = posed[samples]
    a, b = (transfer_pose(mesh, V, vertices=200, samplings=1, seed=7) for V in (posed, blind))
    assert np.array_equal(a.vertices, b.vertices)


@pytest.mark.parametrize("frames", ["triangle", "blended"])
def test_with_the_residual_frames_carry_the_edit_alone(mesh, frames):
    posed, edited = bent(mesh.V), np.array(mesh.V)
    region = mesh.V[:, 2] > 1
    edited[region] *= 1.1
    options = {"vertices": 200, "samplings": 2, "frames": frames}
    plain = transfer_pose(mesh, posed, edited, **options).vertices
    found = transfer_pose(mesh, posed, edited, residual=True, **options).vertices
    expected = plain - transfer_pose(mesh, posed, **options).vertices + posed
    assert np.abs(found - expected).max() < ROUNDING * mesh.diagonal
    assert np.abs(found - posed)[~region].max() < ROUNDING * mesh.diagonal
    truth = bent(edited)
    assert np.abs(found - truth).mean() < np.abs(plain - truth).mean()
