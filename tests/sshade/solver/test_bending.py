"""The bending energy compared with its definition and a clamped plate, and independent of solvers."""

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from baselines.accelerated import local_global
from sshade import DeformationTask, Mesh
from sshade.solver.local_global import LocalGlobal
from sshade.solver.multigrid import Multigrid
from tests.shapes import bumpy, held_ends, jittered, moved_parts, strip
from tests.sshade.method.test_degenerate import split
from tests.sshade.naive import TASKS, Naive, vertex_areas

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
    solver = LocalGlobal(task.mesh, task.handles.index, energy=energy, bending=LENGTH)
    naive, U = NaiveBending(task, energy, LENGTH), task.mesh.V
    assert 0 < np.count_nonzero(naive.share) < task.mesh.n
    for iterations in range(1, 5):
        U = naive.iterate(U)
        ours = solver.solve(task.handles.target, max_iterations=iterations, tolerance=0, accelerate=False)
        assert np.abs(ours.positions - U).max() < 1e-11 * task.mesh.diagonal
    R = naive.rotations(U)
    assert np.abs(ours.rotations - R).max() < 1e-9
    assert ours.energy == pytest.approx(naive.energy(U, R), rel=1e-9)


def test_a_sheet_between_two_circles_bends_as_a_clamped_plate_does():
    """The middle is lifted a little without a turn.

    Kirchhoff's solution for the height at radius r is a + b r^2 + c log r + d r^2 log r.
    """
    mesh = Mesh(jittered(strip(60, 60), 0.05, seed=1).V * [1, 1, 0] - [30, 30, 0], strip(60, 60).F)
    r, inner, outer, lift = np.linalg.norm(mesh.V, axis=1), 6.0, 28.0, 0.01
    own = moved_parts(mesh.V, (r < inner, [0, 0, lift]), (r > outer, 0))
    task = DeformationTask("plate", mesh, own)
    V = local_global(task, bending=1.0, tolerance=1e-12, max_iterations=3000).vertices

    def basis(r):
        return np.stack([r**0, r**2, np.log(r), r**2 * np.log(r)], axis=-1)

    def slopes(r):
        return np.stack([0 * r, 2 * r, 1 / r, 2 * r * np.log(r) + r], axis=-1)

    ends = np.array([inner, outer])
    a = np.linalg.solve(np.concatenate([basis(ends), slopes(ends)]), [lift, 0, 0, 0])
    free = np.delete(np.arange(mesh.n), own.index)
    plate, membrane = basis(r[free]) @ a, lift * np.log(outer / r[free]) / np.log(outer / inner)
    assert np.abs(V[free, 2] - plate).max() < 0.25 * np.abs(membrane - plate).max()
    assert np.abs(V[:, :2] - mesh.V[:, :2]).max() < 1e-4


def test_faces_without_area_change_the_shape_little():
    mesh = bumpy(3)
    faces, task = np.arange(0, mesh.m, 7), held_ends(mesh)
    flat = split(mesh, faces, np.full(len(faces), 0.5))
    assert flat.without_area.any()
    same = DeformationTask("flat", flat, task.handles)
    V, W = (local_global(t, bending=0.02, tolerance=1e-8).vertices for t in (task, same))
    assert np.isfinite(W).all()
    assert np.abs(W[: mesh.n] - V).max() < 0.02 * mesh.diagonal


@pytest.mark.parametrize("stiffness", [1.0, 0.1])
def test_v_cycles_reach_the_minimum_of_the_factorisation(monkeypatch, stiffness):
    """The coarsest level is small, so that the multigrid has several levels."""
    monkeypatch.setitem(Multigrid.__init__.__kwdefaults__, "coarsest", 20)
    task = held_ends(bumpy(3))
    energy = {"bending": 0.03, "stiffness": stiffness, "tolerance": 1e-9, "max_iterations": 3000}
    expected = local_global(task, factorised=True, **energy)
    found = local_global(task, factorised=False, **energy)
    assert found.extra["energy"] == pytest.approx(expected.extra["energy"], rel=1e-6)
    assert np.abs(found.vertices - expected.vertices).max() < 1e-4 * task.mesh.diagonal
    without = local_global(task, factorised=False, **energy | {"bending": 0.0})
    assert np.abs(found.vertices - without.vertices).max() > 1e-3 * task.mesh.diagonal


def test_a_large_mesh_is_factorised_where_it_bends(monkeypatch):
    task = TASKS["bar"]
    expected = local_global(task, bending=LENGTH).vertices
    monkeypatch.setattr("sshade.solver.local_global.FACTORISED", 1)
    np.testing.assert_array_equal(local_global(task, bending=LENGTH).vertices, expected)
