"""The bending energy compared with its definition and a clamped plate, and independent of solvers."""

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from baselines.accelerated import local_global
from sshade import DeformationTask
from sshade.solver.aim import Aim
from tests.shapes import bumpy, held_ends
from tests.sshade.naive import TASKS, Naive, vertex_areas
from tests.sshade.solver.solver import Solver

LENGTH = 0.05


class NaiveBending(Naive):
    """Plain local/global iterations with bending energy, from dense matrices."""

    def __init__(self, task: DeformationTask, energy: str, bending: float) -> None:
        super().__init__(task, energy)
        mesh, n = task.mesh, task.mesh.n
        self.share = bending**2 * mesh.area / vertex_areas(mesh)
        held = np.isin(np.arange(n), self.index)
        for i in range(n):
            around = np.append(mesh.edges[(mesh.edges == i).any(axis=1)].ravel(), i)
            if held[around].all() or i in mesh.boundary_edges:
                self.share[i] = 0.0
        self.weight = {"spokes": 2, "spokes_and_rims": 3}[energy]
        whole = self.L + self.L @ np.diag(self.share) @ self.L
        self.to_handles = whole[self.free][:, self.index]
        self.lu = splu(csc_matrix(whole[self.free][:, self.free]))

    def covariances(self, U: np.ndarray) -> np.ndarray:
        bent = np.einsum("i,ia,ib->iab", self.weight * self.share, self.L @ self.V, self.L @ U)
        return super().covariances(U) + bent

    def energy(self, U: np.ndarray, R: np.ndarray) -> float:
        off = self.L @ U - np.einsum("iab,ib->ia", R, self.L @ self.V)
        return super().energy(U, R) + self.weight * float(self.share @ (off**2).sum(axis=1))

    def right_hand_side(self, R: np.ndarray) -> np.ndarray:
        turned = np.einsum("iab,ib->ia", R, self.L @ self.V)
        return super().right_hand_side(R) + self.L @ (self.share[:, None] * turned)


@pytest.mark.parametrize("energy", ["spokes", "spokes_and_rims"])
@pytest.mark.parametrize("name", TASKS)
def test_plain_iterations_equal_the_definition(name, energy):
    task = TASKS[name]
    solver = Solver(task.mesh, task.handles.index, energy=energy, bending=LENGTH)
    naive, U = NaiveBending(task, energy, LENGTH), task.mesh.V
    assert 0 < np.count_nonzero(naive.share) < task.mesh.n
    for iterations in range(1, 5):
        U = naive.iterate(U)
        ours = solver.solve(
            Aim(task.handles.target), max_iterations=iterations, tolerance=0, accelerate=False
        )
        assert np.abs(ours.positions - U).max() < 1e-11 * task.mesh.diagonal
    R = naive.rotations(U)
    assert np.abs(ours.rotations - R).max() < 1e-9
    assert ours.energy == pytest.approx(naive.energy(U, R), rel=1e-9)


@pytest.mark.parametrize("stiffness", [1.0, 0.1])
def test_v_cycles_reach_the_minimum_of_the_factorisation(monkeypatch, stiffness):
    """The coarsest level is small, so that the multigrid has several levels."""
    monkeypatch.setattr("sshade.solver.multigrid.COARSEST", 20)
    task = held_ends(bumpy(3))
    energy = {"bending": 0.03, "stiffness": stiffness, "tolerance": 1e-9, "max_iterations": 3000}
    expected = local_global(task, factorised=True, **energy)
    found = local_global(task, factorised=False, **energy)
    assert found.extra["energy"] == pytest.approx(expected.extra["energy"], rel=1e-6)
    assert np.abs(found.vertices - expected.vertices).max() < 1e-4 * task.mesh.diagonal
    without = local_global(task, factorised=False, **energy | {"bending": 0.0})
    assert np.abs(found.vertices - without.vertices).max() > 1e-3 * task.mesh.diagonal
