from __future__ import annotations

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.arap import libigl_arap
from sshade import DeformationTask, Handles, InputError, Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.solver.start import initial_guess
from tests.shapes import bumpy, held_ends, icosphere, rotation

ENERGIES = {
    "spokes": igl.ARAPEnergyType.ARAP_ENERGY_TYPE_SPOKES,
    "spokes_and_rims": igl.ARAPEnergyType.ARAP_ENERGY_TYPE_SPOKES_AND_RIMS,
}


@pytest.fixture(scope="module")
def task() -> DeformationTask:
    """The lower end of a body held, the upper end turned and lifted."""
    return held_ends(bumpy(2), turn=Rotation.from_euler("y", 50, degrees=True).as_matrix())


def igl_positions(task: DeformationTask, energy: str, iterations: int, start: np.ndarray) -> np.ndarray:
    data = igl.ARAPData()
    data.energy, data.max_iter = ENERGIES[energy], iterations
    V, F = np.array(task.mesh.V), np.array(task.mesh.F)
    igl.arap_precomputation(V, F, 3, np.array(task.handles.index), data)
    return igl.arap_solve(np.array(task.handles.target), data, start)


@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("iterations", [1, 7, 40])
def test_iterations_one_a_call_equal_one_libigl_call_bit_for_bit(task, energy, iterations):
    result = libigl_arap(task, energy=energy, tolerance=0, max_iterations=iterations)
    start = task.mesh.V.copy()
    start[task.handles.index] = task.handles.target
    assert np.array_equal(result.vertices, igl_positions(task, energy, iterations, start))
    assert result.iterations == iterations and result.converged is False


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_iteration_stops_at_the_first_residual_below_the_tolerance(task, tolerance):
    result = libigl_arap(task, tolerance=tolerance)
    assert result.converged is True and result.extra["residual"] < tolerance
    counts = (result.iterations - 1, result.iterations)
    before, last = (libigl_arap(task, tolerance=0, max_iterations=count).vertices for count in counts)
    residual = np.linalg.norm(last - before, axis=1).max() / task.mesh.diagonal
    assert np.array_equal(last, result.vertices)
    assert result.extra["residual"] == pytest.approx(residual, rel=1e-12)
    earlier = libigl_arap(task, tolerance=tolerance, max_iterations=result.iterations - 1)
    assert earlier.converged is False and earlier.extra["residual"] >= tolerance


def test_the_residual_is_relative_to_the_diagonal(task):
    """libigl scales out the unit of length, so that another unit takes as many iterations."""
    handles = Handles(task.handles.index, task.handles.target * 1024)
    scaled = DeformationTask("scaled", Mesh(task.mesh.V * 1024, task.mesh.F), handles)
    a, b = libigl_arap(task, tolerance=1e-3), libigl_arap(scaled, tolerance=1e-3)
    assert a.iterations == b.iterations
    assert b.extra["residual"] == pytest.approx(a.extra["residual"], rel=1e-3)


def test_progress_counts_the_iterations(task):
    seen = []
    options = {"tolerance": 1e-3, "max_iterations": 500}
    result = libigl_arap(task, progress=lambda *report: seen.append(report), **options)
    assert [done for _, done, _, _ in seen][:-1] == list(range(1, result.iterations + 1))
    assert {(stage, total) for stage, _, total, _ in seen} == {("iterations", 500)}
    assert f"{result.extra['residual']:.1e}" in seen[-1][3]


def test_the_rigid_start_is_the_best_rigid_motion_of_the_handles(task):
    U = initial_guess(task, "rigid")
    R, t = rigid_motion(task.mesh.V[task.handles.index], task.handles.target)
    free = np.setdiff1d(np.arange(task.mesh.n), task.handles.index)
    assert np.allclose(U[free], task.mesh.V[free] @ R.T + t, rtol=0, atol=1e-14)
    assert np.array_equal(U[task.handles.index], task.handles.target)
    result = libigl_arap(task, start="rigid", tolerance=0, max_iterations=3)
    assert np.array_equal(result.vertices, igl_positions(task, "spokes_and_rims", 3, U))


def test_a_rigid_start_of_rigidly_moved_handles_is_already_the_answer():
    mesh, turn, shift = bumpy(2), rotation(7), np.array([1.0, 2, 3])
    index = np.arange(0, mesh.n, 9)
    task = DeformationTask("rigid", mesh, Handles(index, mesh.V[index] @ turn.T + shift))
    result = libigl_arap(task, start="rigid")
    # libigl fits rotations in single precision.
    assert np.allclose(result.vertices, mesh.V @ turn.T + shift, rtol=0, atol=1e-5 * mesh.diagonal)
    assert result.converged and result.iterations == 1


def test_unknown_energies_are_refused(task):
    with pytest.raises(InputError, match="unknown energy 'elements'; use 'spokes' or 'spokes_and_rims'"):
        libigl_arap(task, energy="elements")


def test_triangles_without_area_are_refused_before_the_first_iteration():
    V = icosphere(1).V.copy()
    a, b, c = icosphere(1).F[0]
    V[c] = V[a]
    mesh = Mesh(V, icosphere(1).F)
    seen = []
    task = DeformationTask("degenerate", mesh, Handles([20, 30], V[[20, 30]] + 1))
    with pytest.raises(InputError, match="no area"):
        libigl_arap(task, progress=lambda *args: seen.append(args))
    assert not seen
