"""Bind once, deform many times."""

import numpy as np
import pytest

from sshade import DeformationTask, Deformer, Handles, Mesh, sshade
from tests.shapes import bumpy


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return bumpy()


@pytest.fixture(scope="module")
def held(mesh: Mesh) -> np.ndarray:
    order = np.argsort(mesh.V[:, 2])
    return np.concatenate([order[:8], order[-8:]])


def lifted(mesh: Mesh, held: np.ndarray, height: float) -> np.ndarray:
    return mesh.V[held] + np.where(np.arange(16) < 8, 0.0, height)[:, None] * [0.5, 0, 1]


@pytest.mark.parametrize("samplings", [1, 3])
def test_the_first_call_equals_deform(mesh, held, samplings):
    targets = lifted(mesh, held, 0.5)
    once = sshade(
        DeformationTask("lift", mesh, Handles(held, targets)), vertices=150, samplings=samplings, seed=4
    )
    bound = Deformer(mesh, held, method="paper", vertices=150, samplings=samplings, seed=4)(targets)
    np.testing.assert_array_equal(bound.vertices, once.vertices)
    assert bound.iterations == once.iterations


def test_a_drag_takes_fewer_iterations_and_ends_where_a_cold_solve_does(mesh, held):
    drag = Deformer(mesh, held, method="paper", vertices=150)
    drag(lifted(mesh, held, 0.3))
    steps = [drag(lifted(mesh, held, 0.3 + 0.01 * step)).iterations for step in range(1, 6)]
    released = drag(lifted(mesh, held, 0.35), tolerance=1e-9)
    drag.reset()
    cold = drag(lifted(mesh, held, 0.35), tolerance=1e-9)
    assert max(steps) < cold.iterations
    assert np.abs(released.vertices - cold.vertices).max() < 1e-5 * mesh.diagonal
    assert released.extra["energy"][0] == pytest.approx(cold.extra["energy"][0], rel=1e-6)


def test_a_cutoff_is_resumed_by_the_next_call(mesh, held):
    targets = lifted(mesh, held, 0.5)
    drag = Deformer(mesh, held, method="paper", vertices=150)
    first = drag(targets, max_iterations=3)
    assert first.iterations == 3 and not first.converged
    assert drag(targets, max_iterations=200).extra["residual"] < first.extra["residual"]


def test_targets_at_rest_give_the_rest_shape(mesh, held):
    result = Deformer(mesh, held, method="paper", vertices=150)(mesh.V[held])
    assert np.abs(result.vertices - mesh.V).max() < 1e-10 * mesh.diagonal
