"""Measures: flat, inverted and intersecting faces, tails, and distances to the truth."""

import gc
import weakref

import numpy as np
import pytest
import trimesh
from eval_cases import ends_task
from scipy.optimize import linprog

from eval.metrics import METRICS, Deformed, measure
from eval.metrics.deformation import chamfer, collapsed, distortion, distortion_max, hausdorff
from eval.metrics.shape import MeasuredShape, ShapeTopology, intersecting_faces, weighted_percentile
from sshade import DeformationTask, Handles, Mesh, TransferTask
from tests.shapes import bumpy, icosphere, rotation
from tests.sshade.proxy.test_projection import nearest_in_triangle


def task(mesh: Mesh) -> DeformationTask:
    index = np.array([0, mesh.n - 1])
    return DeformationTask("task", mesh, Handles(index, mesh.V[index], group=np.arange(2)))


def shape(V: np.ndarray, F: np.ndarray) -> MeasuredShape:
    return MeasuredShape(ShapeTopology(F, len(V)), V)


def test_zero_area_rest_faces_are_left_out_and_counted():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1]])
    F = np.array([[0, 1, 2], [0, 3, 4], [0, 2, 5], [3, 4, 5]])
    moved = V.copy()
    moved[2] = [0, 2, 0]
    mesh = Mesh(V, F)
    found = measure(task(mesh), moved)
    assert found["zero_area_faces"] == 1
    before, after = (shape(X, F).corner_angles[[0, 2, 3]] for X in (V, moved))
    assert found["angle_relative"] == pytest.approx(100 * (np.abs(after - before) / before).mean())


def test_flips_face_by_face():
    mesh = bumpy(2)
    moved = mesh.V + np.random.default_rng(0).normal(0, 0.05 * mesh.diagonal, mesh.V.shape)

    def opposed(V: np.ndarray) -> np.ndarray:
        surface = trimesh.Trimesh(V, mesh.F, process=False)
        around = np.zeros((mesh.m, 3))
        for one, two in surface.face_adjacency:
            around[one] += surface.face_normals[two]
            around[two] += surface.face_normals[one]
        return (surface.face_normals * around).sum(axis=1) < 0

    assert not opposed(mesh.V).any() and measure(task(mesh), moved)["flips"] == opposed(moved).sum() > 0
    # Folds of the rest shape do not count.
    assert measure(task(Mesh(moved, mesh.F)), moved)["flips"] == 0


def test_what_is_measured_of_a_mesh_is_shared_and_goes_with_the_mesh():
    mesh = bumpy(1)
    assert measure(task(mesh), mesh.V)["edge"] == 0
    one, other = (Deformed(task(mesh), factor * mesh.V) for factor in (1, 2))
    assert one.rest is other.rest  # it is measured once
    del one, other
    gone = weakref.ref(mesh)
    del mesh
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_rigid_motion_is_no_deformation(scale):
    mesh = bumpy()
    mesh = Mesh(scale * mesh.V, mesh.F)
    moved = mesh.V @ rotation(3).T + scale * np.array([1e5, -2e5, 1e5])
    found = measure(task(mesh), moved)
    assert found.pop("handle") > 1
    assert found == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-5)


def test_a_face_that_loses_its_area_is_infinitely_distorted_and_one_without_is_left_out():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]])
    mesh = Mesh(V, np.array([[0, 3, 2], [3, 1, 2], [0, 1, 3]]))  # the last face has no area
    assert np.isnan(Deformed(task(mesh), V).singular_values[0][2])
    assert distortion_max(Deformed(task(mesh), V)) == pytest.approx(0.0, abs=1e-12)
    assert collapsed(Deformed(task(mesh), V)) == 0
    flat = V * [1.0, 0.0, 1.0]
    lost = Deformed(task(mesh), flat)
    assert np.isinf(lost.dirichlet[:2]).all() and np.isinf(distortion(lost)) and collapsed(lost) == 2
    assert np.isnan(weighted_percentile(np.empty(0), np.empty(0), 50.0))


def test_a_measure_without_a_finite_value_is_none():
    def lacking(F, scale) -> set[str]:
        V = np.vstack([np.zeros(3), np.eye(3), [0, 0, -1.0]])[: np.max(F) + 1]
        found = measure(task(Mesh(V, np.array(F))), scale * V)
        return {name for name, value in found.items() if value is None}

    assert lacking([[0, 1, 2], [0, 2, 1]], 2) == {"volume"}  # closed around nothing
    three = lacking([[0, 1, 2], [1, 0, 3], [0, 1, 4]], 2)
    assert three == {"volume", "bend", "bend_tail", "spike", "detail"}
    assert lacking([[0, 1, 2], [1, 0, 3]], [1, 0, 1]) > {"volume", "distortion", "distortion_max"}


OF_TRUTH = {name for name, metric in METRICS.items() if "truth" in metric.needs}
OF_HANDLES = {"handle", "spike"}


def transfer_task(mesh, truth):
    return TransferTask("t", mesh, mesh, truth, truth=truth)


def brute_force(P, V, F):
    return np.array([min(nearest_in_triangle(p, V[face]) for face in F) for p in P])


def test_against_brute_force():
    mesh = bumpy(1)
    rng = np.random.default_rng(0)
    truth = 3 + 2 * mesh.V * [1, 0.8, 1.1]
    vertices = truth + rng.normal(0, 0.2, truth.shape)
    centre = truth.mean(axis=0)
    scale = np.linalg.norm(truth - centre, axis=1).max()
    a, b = (truth - centre) / scale, (vertices - centre) / scale
    there, back = brute_force(b, a, mesh.F), brute_force(a, b, mesh.F)
    task = transfer_task(mesh, truth)
    assert hausdorff(Deformed(task, vertices)) == pytest.approx(max(there.max(), back.max()), rel=1e-9)
    assert chamfer(Deformed(task, vertices)) == pytest.approx((there**2).mean() + (back**2).mean(), rel=1e-9)
    assert there.max() != back.max()


def test_a_task_gets_the_metrics_that_it_has_what_it_takes_for():
    task = ends_task(bumpy(1))
    without = set(measure(task, task.mesh.V))
    assert without == set(METRICS) - OF_TRUTH
    known = DeformationTask("t", task.mesh, Handles(np.array([0]), task.mesh.V[:1]), truth=task.mesh.V)
    # Only transfers have surface distances.
    assert set(measure(known, task.mesh.V)) == set(METRICS) - {"hausdorff", "chamfer"}
    assert set(measure(transfer_task(task.mesh, task.mesh.V), task.mesh.V)) == set(METRICS) - OF_HANDLES
    unknown = TransferTask("t", task.mesh, task.mesh, task.mesh.V)
    assert set(measure(unknown, task.mesh.V)) == without - OF_HANDLES


TWO = np.array([[0, 1, 2], [3, 4, 5]])
WALL = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


def meet(V, F=TWO) -> bool:
    found = intersecting_faces(np.array(V, dtype=float), np.array(F))
    assert found.all() or not found.any()
    return bool(found.any())


def triangles_meet(one, two):
    """Return whether two triangles have a common point, by linear programming.

    A common point is a convex combination of the corners of each triangle. Corners are small integers, so
    triangles that do not meet are apart by much more than the tolerance.
    """
    A = np.vstack([np.hstack([one.T, -two.T]), np.kron(np.eye(2), np.ones(3))])
    return linprog(np.zeros(6), A_eq=A, b_eq=[0, 0, 0, 1, 1]).status == 0


@pytest.mark.parametrize("size", [2, 3, 6])
def test_faces_without_a_common_corner_against_linear_programs(size):
    """On a grid this small, most pairs of faces touch, lie in one plane, or include a face without area."""
    rng = np.random.default_rng(size)
    flat = 0
    for V in rng.integers(0, size, (350, 6, 3)):
        one, two = V[:3], V[3:]
        points = any((face == face[0]).all() for face in (one, two))
        assert meet(V) == (not points and triangles_meet(one, two)), V.tolist()
        flat += not np.cross(V[1] - V[0], V[2] - V[0]).any()
    assert flat > 2


def test_a_collapsed_face_through_a_wall_counts_although_it_has_no_plane():
    through = [[1, 1, -1], [1, 1, 1], [1, 1, 0.25]]
    assert meet(WALL + through)
    # A collapsed face beside the wall does not count, although the two overlap when seen along z.
    beside = [[0.5, 0.5, 3], [3.5, 3.5, -1], [2.75, 2.75, 0]]
    assert not meet(WALL + beside) and not meet(beside + WALL)
    # A needle through the wall counts, too; its height is 1e-13.
    assert meet([*WALL, [1, 1, -1], [1, 1, 1], [1 + 1e-13, 1, 0.25]])
    assert not meet(WALL + 3 * [[1, 1, 0]])


def test_neighbours():
    corner = [[0, 1, 2], [0, 3, 4]]
    assert meet([*WALL, [2, 2, 1], [1, 1, -1]], corner)
    assert meet([*WALL, [4, 1, 0], [1, 4, 0]], corner)  # in one plane
    assert not meet([*WALL, [-1, 0, 1], [-1, 1, 0]], corner)
    edge = [[0, 1, 2], [1, 0, 3]]
    assert meet([*WALL, [1, 3, 0]], edge)  # folded flat
    assert not meet([*WALL, [1, 3, 1e-3]], edge)
    assert not meet([*WALL, [1, -3, 0]], edge)
    assert not meet([*WALL, [1, -3, 1]], [[0, 1, 2], [0, 1, 3]])  # wound against each other


def test_intersections_do_not_depend_on_the_unit_of_length():
    """libigl decides about faces with a common corner up to an absolute length."""
    rng = np.random.default_rng(0)
    V = np.concatenate([5 * pair + rng.normal(size=(5, 3)) for pair in range(300)])
    F = np.concatenate([np.array([[0, 1, 2], [0, 3, 4]]) + 5 * pair for pair in range(300)])
    found = intersecting_faces(V, F)
    assert 30 < found.sum() < 300
    for unit in (1e-9, 1e-6, 0.3, 1e6):
        np.testing.assert_array_equal(intersecting_faces(unit * V, F), found)


def test_scrambled_vertices_have_no_count_of_crossings():
    """Their faces meet 10 million others, more than memory holds on large meshes."""
    mesh = icosphere(5)
    scrambled = np.random.default_rng(0).random(mesh.V.shape)
    found = [
        METRICS["self_intersections"].function(Deformed(TransferTask("ball", mesh, mesh, mesh.V), V))
        for V in (mesh.V, 0 * mesh.V, scrambled)
    ]
    assert found[:2] == [0, 0] and np.isnan(found[2])
