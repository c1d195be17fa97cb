"""Intersecting faces: agreement with linear programs, collapsed faces, and neighbouring faces."""

import numpy as np
import pytest
from scipy.optimize import linprog

from eval.metrics import METRICS, Deformed
from eval.metrics.shape import intersecting_faces
from sshade import TransferTask
from tests.shapes import icosphere

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
