import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.arap import libigl_arap
from sshade import DeformationTask
from tests.shapes import bumpy, held_ends

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
@pytest.mark.parametrize("iterations", [7, 40])
def test_iterations_one_a_call_equal_one_libigl_call_bit_for_bit(task, energy, iterations):
    result = libigl_arap(task, energy=energy, tolerance=0, max_iterations=iterations)
    start = task.mesh.V.copy()
    start[task.handles.index] = task.handles.target
    assert np.array_equal(result.vertices, igl_positions(task, energy, iterations, start))
    assert result.iterations == iterations and result.converged is False
    before = igl_positions(task, energy, iterations - 1, start)
    moved = np.linalg.norm(result.vertices - before, axis=1).max() / task.mesh.diagonal
    assert result.extra["residual"] == pytest.approx(moved)
