"""Smooth ARAP against ARAP, against its energy written out, and against spikes."""

import numpy as np
import pytest

from baselines.accelerated import local_global
from baselines.smooth_arap import smooth_arap
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from tests.shapes import bumpy, held_ends
from tests.sshade.naive import vertex_areas


@pytest.mark.parametrize("energy", ["spokes", "spokes_and_rims"])
def test_without_smoothness_it_is_arap(energy):
    task = held_ends(bumpy(2))
    assert (smooth_arap(task, max_iterations=0).extra["rotations"] == np.eye(3)).all()
    ours = smooth_arap(task, smoothness=0.0, energy=energy, tolerance=0, max_iterations=25)
    arap = local_global(task, energy=energy, accelerate=False, tolerance=0, max_iterations=25)
    assert np.abs(ours.vertices - arap.vertices).max() < 1e-11 * task.mesh.diagonal


def energy_of(mesh, P, R, smoothness):
    """The energy of the module's docstring, edge by edge and vertex by vertex."""
    edges, w = edge_weights(mesh, half_cotangents(mesh))
    L = laplacian_matrix(mesh.n, edges, w).toarray()
    a = vertex_areas(mesh) / vertex_areas(mesh).mean()
    total, b = 0.0, np.zeros((mesh.n, 3))
    for (i, j), weight in zip(edges, w, strict=True):
        rest, now = mesh.V[i] - mesh.V[j], P[i] - P[j]
        for k in (i, j):
            total += (1 - smoothness) / 2 * weight * np.sum((now - R[k] @ rest) ** 2)
        mean = 0.5 * (R[i] + R[j]) @ rest
        b[i] += weight * mean
        b[j] -= weight * mean
    return total + smoothness * np.sum((L @ P - b) ** 2 / a[:, None])


@pytest.mark.parametrize("smoothness", [0.3, 0.97])
def test_the_global_step_minimises_the_energy_for_its_rotations(smoothness):
    task = held_ends(bumpy(1))
    result = smooth_arap(task, smoothness=smoothness, tolerance=0, max_iterations=7)
    R = result.extra["rotations"]
    least = energy_of(task.mesh, result.vertices, R, smoothness)
    rng = np.random.default_rng(1)
    free = np.setdiff1d(np.arange(task.mesh.n), task.handles.index)
    for size in (1e-1, 1e-3):
        step = np.zeros_like(result.vertices)
        step[free] = size * rng.normal(size=(len(free), 3))
        up, down = (energy_of(task.mesh, result.vertices + s * step, R, smoothness) for s in (1, -1))
        # A quadratic has the same rise to both sides of its minimum, and only there.
        assert up > least and down > least
        assert up - least == pytest.approx(down - least, rel=1e-5)
