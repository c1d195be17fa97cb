"""Rotations of stored normals, whatever the order of the corners and the rounding of the numbers."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.mesh.mesh import unit_rows
from sshade.mesh.normals import NORMALS, SMOOTH, smooth_groups, turned, vertex_turns
from tests.shapes import icosphere

#: Without triangles of equal area: the largest triangle at a vertex is the same in any order.
ROUND = icosphere(3)
BALL = Mesh(unit_rows(ROUND.V + np.random.default_rng(0).uniform(-0.03, 0.03, (642, 3))), ROUND.F)
POSED = BALL.V * [1.0, 1.5, 0.75] + 0.2 * BALL.V[:, [1, 2, 0]] ** 2
TURNED = vertex_turns(BALL.V, BALL.F, BALL.V, POSED)


def random_side(F):
    return np.where(np.random.default_rng(0).random((len(F), 1)) < 0.5, F, F[:, ::-1])


@pytest.mark.parametrize(
    "faces",
    [lambda F: F[:, ::-1], random_side, lambda F: np.concatenate([F, F[:, ::-1]])],
    ids=["turned around", "of random sides", "with both sides"],
)
def test_normals_do_not_depend_on_the_sides_of_triangles(faces):
    F = np.ascontiguousarray(faces(BALL.F))
    found = turned(vertex_turns(BALL.V, F, BALL.V, POSED), BALL.V)
    np.testing.assert_allclose(found, turned(TURNED, BALL.V), rtol=0, atol=1e-12)


def test_a_seam_with_rounded_normals_stays_smooth():
    """Each triangle has corners of its own, and their normals are rounded to three decimals."""
    F = np.arange(BALL.F.size).reshape(-1, 3)
    noise = np.random.default_rng(0).uniform(-0.4, 0.4, (F.size, 3)) * 1e-3
    N = np.round(BALL.V[BALL.F.ravel()] + noise, 3)
    rest = BALL.V[BALL.F.ravel()] + 1e-9 * noise
    rest.setflags(write=False)
    Q = vertex_turns(N, F, rest, POSED[BALL.F.ravel()])
    np.testing.assert_allclose(Q, TURNED[BALL.F.ravel()], rtol=0, atol=2e-6)


def test_a_hard_edge_stays_hard():
    place = np.zeros((4, 3))
    N = unit_rows(np.array([[0, 0, 1.0], [0, 0.9 * SMOOTH, 1], [0, 2.5 * SMOOTH, 1], [0, 0, np.nan]]))
    group, one = smooth_groups(place, N)
    assert group.tolist() == [0, 0, 1, 2] and one.tolist() == [0, 2, 3]
    crowd = unit_rows(np.stack([np.ones(60), np.arange(60) % 30, np.zeros(60)], axis=1))
    assert NORMALS < 30
    group, one = smooth_groups(np.zeros((60, 3)), crowd)
    assert group.tolist() == 2 * list(range(30)) and one.tolist() == list(range(30))
