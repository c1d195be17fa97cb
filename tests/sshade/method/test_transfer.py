"""Isometric reconstruction and pose transfer."""

import numpy as np
import pytest

from sshade import Mesh, TransferTask, bind, transfer_pose
from sshade.method.transfer import transfer
from tests.shapes import bent, beside, bumpy, rotation, shifted
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


def test_seeds_and_samplings_reach_each_component(mesh):
    two = beside(mesh, shifted(mesh, 4))
    posed = bent(two.V)
    found = {
        (seed, samplings): transfer_pose(two, posed, vertices=300, seed=seed, samplings=samplings).vertices
        for seed, samplings in ((0, 1), (1, 1), (0, 5))
    }
    for part in (slice(mesh.n), slice(mesh.n, None)):
        error = {key: np.linalg.norm(V[part] - posed[part], axis=1).mean() for key, V in found.items()}
        assert error[0, 1] != error[1, 1]
        assert error[0, 5] < 0.8 * min(error[0, 1], error[1, 1])


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


@pytest.fixture(scope="module")
def task():
    rest = bumpy(3)
    edited = Mesh(rest.V + 0.05 * np.sin(5 * rest.V[:, [1, 2, 0]]), rest.F)
    return TransferTask("t", edited, rest, bent(rest.V), truth=bent(edited.V))


def test_every_option_counts_and_a_task_gives_what_its_shapes_give(task):
    base = {"vertices": 150, "samplings": 1}
    shape = transfer(task, **base).vertices
    others = {"vertices": 100, "samplings": 2, "frames": "blended", "residual": True, "seed": 1}
    for name, value in others.items():
        assert not np.array_equal(transfer(task, **base | {name: value}).vertices, shape)
    posed = transfer_pose(task.rest, task.posed, task.mesh.V, **base)
    assert np.array_equal(posed.vertices, shape)
    calls = []
    transfer(task, **base, progress=lambda *args: calls.append(args))
    assert [done for _, done, _ in calls] == list(range(calls[0][2] + 1)) and calls[0][2] > 0
