"""Prescribed rotations of handles: exact solutions, effect, resolution, invariance, levels, and files."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from baselines.arap import arap
from sshade import DeformationTask, Handles, InputError, Mesh, deform
from sshade.files.task_files import read_handles
from sshade.mesh.rigid import rigid_motion
from sshade.method import start
from sshade.method.start import OnceSolver
from sshade.problem.options import resolve
from sshade.solver.local_global import LocalGlobal, solve_task
from tests.shapes import block, bumpy, jittered, moved_parts, rotation, strip, tube
from tests.sshade.method.calls import METHODS
from tests.sshade.naive import Naive

BODY = bumpy(3)


def turn(degrees: float, axis: str = "z") -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def sheet(cells: int, *, degrees: float, axis: str = "z") -> DeformationTask:
    """Return a unit square with a fixed border and a middle that is turned in place."""
    given = strip(cells, cells)
    mesh = Mesh(given.V / cells, given.F)
    away = np.abs(mesh.V[:, :2] - 0.5).max(axis=1)
    parts = (away > 0.5 - 1e-9, 0), (away < 1e-9, 0)
    return DeformationTask("sheet", mesh, moved_parts(mesh.V, *parts, rotations=[None, turn(degrees, axis)]))


def turned_about(mesh: Mesh, V: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """Return the rotation that best fits the motion of the vertices within a radius of `centre`."""
    near = np.linalg.norm(mesh.V - centre, axis=1) < radius
    return rigid_motion(mesh.V[near], V[near])[0]


def degrees_of(R: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


def test_with_all_rotations_known_positions_are_those_of_least_squares():
    mesh, held = bumpy(1), np.array([0, 7])
    rng = np.random.default_rng(1)
    R = Rotation.from_rotvec(0.4 * rng.normal(size=(mesh.n, 3))).as_matrix()
    target = mesh.V[held] + rng.normal(size=(2, 3))
    naive = Naive(DeformationTask("known", mesh, Handles(held, target)), "spokes_and_rims")
    order = rng.permutation(mesh.n)
    solution = LocalGlobal(mesh, held).solve(target, prescribed=(order, R[order]), tolerance=1e-12)
    assert np.abs(solution.positions - naive.positions(R)).max() < 1e-10
    assert np.array_equal(solution.rotations, R)
    assert solution.energy == pytest.approx(naive.energy(solution.positions, R), rel=1e-10)
    # With softening, the solve also keeps the prescribed rotations and converges.
    soft = LocalGlobal(mesh, held).solve(target, prescribed=(order, R[order]), tolerance=1e-9, stiffness=0.2)
    assert np.array_equal(soft.rotations, R) and soft.converged


@pytest.mark.parametrize("weight", [np.inf, 2.0])
def test_minima_are_those_of_another_minimiser(weight):
    """L-BFGS-B minimises the energy of hard or soft handles with rotations over all positions that move."""
    mesh = block(np.ones((1, 1, 3)))
    z = mesh.V[:, 2]
    turns = {"weights": [np.inf, weight], "rotations": [None, turn(40, "y")]}
    own = moved_parts(mesh.V, (z == z.min(), 0), (z == z.max(), [0.6, 0.3, 0.8]), **turns)
    task = DeformationTask("bar", mesh, own)
    naive, handles = Naive(task, "spokes_and_rims"), task.handles
    free, soft = np.setdiff1d(np.arange(mesh.n), handles.index[handles.hard]), ~handles.hard
    at, known = handles.index[soft], handles.prescribed_rotations

    def placed(x: np.ndarray) -> np.ndarray:
        P = np.array(mesh.V)
        P[handles.index] = handles.target
        P[free] = x.reshape(-1, 3)
        return P

    def energy(x: np.ndarray) -> tuple[float, np.ndarray]:
        P, G = placed(x), np.zeros((mesh.n, 3))
        R = naive.rotations(P)
        R[known[0]] = known[1]
        total = 0.0
        for cell in naive.cells.T:
            miss = P[naive.k] - P[naive.j] - np.einsum("iab,ib->ia", R[cell], naive.rest)
            total += (naive.h * (miss**2).sum(1)).sum()
            np.add.at(G, naive.k, 2 * naive.h[:, None] * miss)
            np.add.at(G, naive.j, -2 * naive.h[:, None] * miss)
        stiffness, off = handles.stiffness[soft][:, None], P[at] - handles.target[soft]
        G[at] += 6 * stiffness * off
        return total + 3 * float((stiffness * off**2).sum()), G[free].ravel()

    how = {"maxiter": 20_000, "maxfun": 40_000, "ftol": 1e-15, "gtol": 1e-9, "maxcor": 40}
    other = minimize(energy, mesh.V[free].ravel(), jac=True, method="L-BFGS-B", options=how)
    result = local_global(task, tolerance=1e-11, max_iterations=20_000)
    assert result.converged and other.fun > 0.01
    assert result.extra["energy"] == pytest.approx(other.fun, rel=1e-7)
    assert np.abs(result.vertices - placed(other.x)).max() < 1e-4


@pytest.mark.parametrize("name", METHODS)
def test_rotations_of_a_rigid_motion_change_nothing(name):
    R, shift = rotation(2), np.array([1.0, -2, 0.5])
    index = np.argsort(BODY.V[:, 2])[[0, 1, 2, -3, -2, -1]]
    own = Handles(index, BODY.V[index] @ R.T + shift, rotation=np.broadcast_to(R, (6, 3, 3)))
    options = {"coarse": partial(local_global, start="rigid")} if name == "paper" else {}
    V = METHODS[name](DeformationTask("rigid", BODY, own), vertices=150, **options).vertices
    assert np.abs(V - BODY.V @ R.T - shift).max() < 1e-6


@pytest.mark.parametrize("axis", ["z", "x"])
@pytest.mark.parametrize("name", ["fast", "fine"])
def test_the_middle_of_a_sheet_follows_a_turn_of_60_degrees(name, axis):
    """The axis is normal to the sheet or lies in the sheet.

    A mesh with four times the vertices turns by the same angle if the proxy has the same size.
    """
    angles = []
    for cells in (40, 80):
        task = sheet(cells, degrees=60, axis=axis)
        result = METHODS[name](task, vertices=300, area=0.0)
        V = result.vertices
        assert np.abs(V[task.handles.index] - task.handles.target).max() < 1e-9
        R = turned_about(task.mesh, V, np.array([0.5, 0.5, 0]), 0.03)
        vector = Rotation.from_matrix(R).as_rotvec(degrees=True)
        assert np.linalg.norm(vector - degrees_of(R) * np.eye(3)["xyz".index(axis)]) < 6
        angles.append(degrees_of(R))
        free = METHODS[name](sheet(cells, degrees=0), vertices=300, area=0.0).vertices
        assert np.abs(free - task.mesh.V).max() < 1e-5
    assert 56 < min(angles) <= max(angles) < 61 and abs(angles[0] - angles[1]) < 1.5


def test_a_disc_of_known_rotations_turns_in_its_sheet_as_elasticity_says():
    """A disc of radius a turns by a small angle in a round sheet that is fixed at radius b.

    Where rotations are fitted, the energy is the elastic energy with Lame's constants 0 and 1. In the disc,
    the energy has the additional term ``2 (c - t)^2``. Here c is the angle of the disc, and t is the
    prescribed angle. Around the disc, the displacement is ``B (1 / r - r / b^2)`` along circles. Therefore
    c = t / (1 + k) with k = 1 / (1 - a^2 / b^2). In a large sheet, c is half of t.
    """
    given, a, b, t = strip(96, 96), 0.2, 0.48, 0.02
    mesh, middle = Mesh(given.V / 96, given.F), np.array([0.5, 0.5, 0])
    distance = np.linalg.norm(mesh.V - middle, axis=1)
    held, disc = np.flatnonzero(distance >= b), np.flatnonzero(distance <= a)
    known = disc, np.broadcast_to(turn(np.degrees(t)), (len(disc), 3, 3))
    V = LocalGlobal(mesh, held).solve(mesh.V[held], prescribed=known, tolerance=1e-9).positions
    k = 1 / (1 - a**2 / b**2)
    found = np.radians(degrees_of(turned_about(mesh, V, middle, 0.8 * a)))
    assert found == pytest.approx(t / (1 + k), rel=0.03)


def test_the_end_of_a_tube_bends_it_and_everything_may_move_together():
    """Only rotations bend the tube: the upper end is turned, but almost no weight pulls at its position."""
    even = tube(24, 60)
    z = even.V[:, 2]
    # On a tube with equal distances, the rounding of a motion would change the samples.
    mesh = jittered(even, 2e-3)
    ends = {"weights": [np.inf, 1e-6], "rotations": [np.eye(3), turn(40, "x")]}
    own = moved_parts(mesh.V, (z == z.min(), 0), (z == z.max(), 0), **ends)
    options = {"vertices": 400, "volume": 0.0, "area": 0.0, "tolerance": 1e-7}
    V = METHODS["fast"](DeformationTask("tube", mesh, own), **options).vertices
    way = np.linalg.norm((V - mesh.V)[z == z.max()].mean(0)) / np.ptp(z)
    assert way > 0.05
    R, shift = rotation(5), np.array([2.0, 3, -1])
    there = Mesh(mesh.V @ R.T + shift, mesh.F)
    turned = replace(own, target=own.target @ R.T + shift, rotation=R @ own.rotation @ R.T)
    V_2 = METHODS["fast"](DeformationTask("tube", there, turned), **options).vertices
    assert np.abs(V_2 - V @ R.T - shift).max() < 1e-5 * mesh.diagonal


def test_levels_take_rotations_along(monkeypatch):
    """The solve on the coarser proxy has the same prescribed rotation as the solve on the proxy."""
    task = sheet(64, degrees=45)
    seen = []

    def spy(given, **options):
        seen.append((given.mesh.n, given.handles.prescribed_rotations))
        return solve_task(given, **options)

    monkeypatch.setattr(start, "solve_task", spy)
    OnceSolver(task.mesh, resolve("fast", {"attachment": 0.0, "tolerance": 1e-7}))(task.handles)
    assert len(seen) == 2 and seen[0][0] < seen[1][0]
    for _, prescribed in seen:
        assert np.array_equal(prescribed[1], turn(45)[None])


def test_arrays_take_one_rotation_for_all_or_one_each_and_others_refuse():
    task = sheet(20, degrees=35)
    mesh, own = task.mesh, task.handles
    U = deform(mesh.V, mesh.F, own.index, own.target, rotations=own.rotation, vertices=100)
    assert np.array_equal(U, METHODS["fast"](task, vertices=100).vertices)
    R = turn(20)
    U = deform(BODY, [3, 9], BODY.V[[3, 9]] @ R.T, rotations=R, vertices=100)
    assert np.abs(U.V - BODY.V @ R.T).max() < 1e-5
    with pytest.raises(InputError, match="takes no rotations"):
        deform(task, method=arap)
    for rotations, words in (
        (2 * np.eye(3), "no rotation"),
        (np.diag([1.0, 1, -1]), "no rotation"),
        (np.eye(3)[None], r"need rotations of shape \(2, 3, 3\)"),
        ([[np.nan, 0, 0], [0, 1, 0], [0, 0, 1]], "no rotation"),
    ):
        with pytest.raises(InputError, match=words):
            deform(BODY, [3, 9], BODY.V[[3, 9]], rotations=rotations)


def test_files_hold_matrices_and_quaternions(tmp_path):
    path = tmp_path / "pose.json"
    R = turn(50, "y")
    x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
    entries = [
        {"vertices": [3, 4], "rotation": R.tolist()},
        {"vertices": [9], "target": [[0, 0, 1]], "rotation": [x, y, z, w], "weight": 2},
        {"vertices": [20]},
        {"source": [(BODY.V[30] + 0.01).tolist()], "target": [[1, 1, 1]], "rotation": [x, y, z, w]},
    ]
    path.write_text(json.dumps({"handles": entries}))
    own = read_handles(path, BODY)
    assert own.index.tolist() == [3, 4, 9, 20, 30]
    assert np.allclose(own.rotation[[0, 1, 2, 4]], R, atol=1e-12) and np.isnan(own.rotation[3]).all()
    assert np.array_equal(own.target[:2], BODY.V[[3, 4]]) and not own.dynamic[:2].any()
    # The source is snapped by (-0.01, -0.01, -0.01), and the target moves by the turned vector.
    assert np.allclose(own.target[4], 1 + R @ np.full(3, -0.01))
