"""Struts between opposite vertices keep the local thickness."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sshade
from baselines.accelerated import local_global
from sshade import DeformationTask, Deformer, Mesh
from sshade.solver.boxes import opposite_vertices
from tests.shapes import icosphere, moved_parts, strip, tube


def hose(wall: float, *, around: int = 32, along: int = 40, length: float = 8.0) -> Mesh:
    """A tube with a wall: an outer and an inner cylinder, joined at both ends."""
    outer = tube(around, along, length=length)
    inner = outer.V * [1 - wall, 1 - wall, 1]
    F = np.concatenate([outer.F, outer.F[:, ::-1] + outer.n])
    for ring, flip in ((0, 1), (outer.n - around, -1)):
        a = ring + np.arange(around)
        b = ring + (np.arange(around) + 1) % around
        for ends in ((a, b, b + outer.n), (a, b + outer.n, a + outer.n)):
            F = np.concatenate([F, np.stack(ends, axis=1)[:, ::-flip]])
    return Mesh(np.concatenate([outer.V, inner]), F)


HOSE = hose(0.25)


def bend_task(mesh: Mesh) -> DeformationTask:
    """One end of the mesh turned by 60 degrees."""
    z, turn = mesh.V[:, 2], Rotation.from_rotvec([0, np.pi / 3, 0])
    turned = z > 7.3, lambda V: turn.apply(V - [0, 0, 8.0]) + [3.6, 0, 6.3]
    return DeformationTask("t", mesh, moved_parts(mesh.V, (z < 0.7, 0), turned))


def test_opposite_vertices_are_across_a_wall_or_a_ball_and_a_sheet_has_none():
    assert HOSE.is_closed and HOSE.is_oriented and HOSE.volume > 0
    for mesh, thickness, most in ((HOSE, 0.25, 0.05), (icosphere(3), 2.0, 0.02)):
        i, j = opposite_vertices(mesh)
        length = np.linalg.norm(mesh.V[i] - mesh.V[j], axis=1)
        assert len(i) > 0.9 * mesh.n and np.median(length) == pytest.approx(thickness, rel=most)
        assert (np.diff(i) > 0).all()
    assert len(opposite_vertices(strip(9, 9))[0]) == 0


@pytest.mark.parametrize("multigrid", [False, True])
def test_the_solver_ends_where_the_energy_is_stationary(multigrid):
    task = bend_task(hose(0.25, around=8, along=12))
    options = {"thickness": 2.0, "attachment": 0.0}
    found = local_global(task, factorised=not multigrid, tolerance=1e-10, max_iterations=4000, **options)
    free = np.setdiff1d(np.arange(task.mesh.n), task.handles.index)

    def energy(V):
        moved = DeformationTask("t", task.mesh, task.handles, guess=V)
        return local_global(moved, max_iterations=0, **options).extra["energy"]

    value, step = energy(found.vertices), 1e-4
    assert found.converged and value > local_global(task, tolerance=1e-9).extra["energy"]
    for seed in range(3):
        Z = np.zeros_like(found.vertices)
        Z[free] = np.random.default_rng(seed).normal(size=(len(free), 3))
        up, down = (energy(found.vertices + sign * step * Z) for sign in (1, -1))
        assert up > value and down > value  # a minimum
        assert abs(up - down) < 1e-3 * (up + down - 2 * value)


@pytest.mark.parametrize("method", ["fast", "fine"])
def test_a_bent_wall_keeps_its_thickness(method):
    task = bend_task(HOSE)
    i, j = opposite_vertices(HOSE)
    rest = np.linalg.norm(HOSE.V[i] - HOSE.V[j], axis=1)
    change = {}
    for weight in (0.0, 3.0):
        V = sshade.deform(task, method=method, thickness=weight, joints=0).vertices
        if method == "fast":
            drag = Deformer(HOSE, task.handles.index, group=task.handles.group, thickness=weight, joints=0)
            assert np.abs(drag.step(task.handles.target).vertices - V).max() < 5e-3
        change[weight] = np.abs(np.linalg.norm(V[i] - V[j], axis=1) / rest - 1)
    assert np.median(change[3.0]) < 0.02 and change[3.0].mean() < 0.5 * change[0.0].mean()
