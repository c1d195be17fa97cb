"""Smooth ARAP against ARAP, against its energy written out, and against spikes."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.smooth_arap import blending_matrix, smooth_arap
from sshade import deform
from sshade.errors import InputError
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.local_global import local_global
from sshade.task import DeformationTask, Handles
from tests.shapes import bumpy, held_ends, jittered, rotation, strip


def ends(level=2):
    return held_ends(bumpy(level))


@pytest.mark.parametrize("energy", ["spokes", "spokes_and_rims"])
def test_without_smoothness_it_is_arap(energy):
    task = ends()
    ours = smooth_arap(task, smoothness=0.0, energy=energy, tolerance=0, max_iterations=25)
    arap = local_global(task, energy=energy, accelerate=False, tolerance=0, max_iterations=25)
    assert np.abs(ours.vertices - arap.vertices).max() < 1e-11 * task.mesh.diagonal


def energy_of(mesh, P, R, smoothness):
    """The energy of the module's docstring, edge by edge and vertex by vertex."""
    edges, w = edge_weights(mesh, half_cotangents(mesh))
    L = laplacian_matrix(mesh.n, edges, w).toarray()
    area = np.zeros(mesh.n)
    for face, own in zip(mesh.F, mesh.face_areas, strict=True):
        area[face] += own / 3
    a = area / area.mean()
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
    task = ends(1)
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


def test_a_single_vertex_makes_no_spike():
    sheet = jittered(strip(16, 16), 0.1)
    centre = int(np.argmin(np.linalg.norm(sheet.V - [8, 8, 0], axis=1)))
    border = np.unique(sheet.boundary_edges)
    target = np.vstack([sheet.V[border], sheet.V[centre] + [0, 0, 3]])
    task = DeformationTask("peak", sheet, Handles(np.append(border, centre), target))
    ring = np.setdiff1d(sheet.F[(centre == sheet.F).any(axis=1)], centre)
    drop = [
        3 - smooth_arap(task, smoothness=s, max_iterations=300).vertices[ring, 2].mean() for s in (0.0, 0.97)
    ]
    assert drop[1] < 0.5 * drop[0]


def test_a_rigid_motion_is_reproduced_from_the_rigid_start():
    mesh = bumpy(2)
    index = np.argsort(mesh.V[:, 2])[[0, 1, 2, 3, -3, -2, -1]]
    R, shift = rotation(3), np.array([1.0, -2, 0.5])
    task = DeformationTask("rigid", mesh, Handles(index, mesh.V[index] @ R.T + shift))
    result = smooth_arap(task, start="rigid")
    assert result.converged
    assert np.abs(result.vertices - (mesh.V @ R.T + shift)).max() < 1e-9 * mesh.diagonal


def test_it_solves_the_proxy_of_sshade():
    task = ends(4)
    result = deform(task, method="paper", coarse=smooth_arap, vertices=400, samplings=1, frames="blended")
    reference = smooth_arap(task, smoothness=0.97)
    assert result.converged
    assert np.abs(result.vertices - reference.vertices).max() < 0.1 * task.mesh.diagonal


def test_the_blending_matrix_of_no_smoothness_is_the_identity():
    mesh = bumpy(1)
    edges, w = edge_weights(mesh, half_cotangents(mesh))
    matrix = blending_matrix(mesh, laplacian_matrix(mesh.n, edges, w), 0.0)
    np.testing.assert_array_equal(matrix.toarray(), np.eye(mesh.n))


@pytest.mark.parametrize(
    "options", [{"smoothness": 1.0}, {"smoothness": -0.1}, {"energy": "rims"}, {"start": "guess"}]
)
def test_options_out_of_range_are_refused(options):
    with pytest.raises(InputError, match="smoothness|energy|start"):
        smooth_arap(ends(1), **options)


def test_soft_handles_are_refused():
    task = ends(1)
    soft = Handles(task.handles.index, task.handles.target, weight=2.0)
    with pytest.raises(InputError, match="Smooth ARAP takes no soft handles"):
        smooth_arap(DeformationTask("soft", task.mesh, soft))
