"""Other meshes move along with a mesh: rigidly with rigid motions, closely near it, and without tears."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import DeformationResult, Mesh, move_along
from sshade.proxy.along import BEYOND, NEAREST, REACH
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.vertex_maps import VertexMaps
from tests.shapes import bent, beside, bumpy, icosphere, jittered, shifted
from tests.sshade.mesh.test_cutting import t_fin

BALL = jittered(icosphere(3), 0.05)


def around(count: int = 400) -> np.ndarray:
    """Points inside of a ball, near it and on it."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * rng.uniform(0.0, 1.4, (count, 1))


def stretch(mesh: Mesh, V: np.ndarray) -> float:
    """The greatest ratio of the lengths of an edge."""
    length, rest = (np.linalg.norm(X[mesh.edges[:, 0]] - X[mesh.edges[:, 1]], axis=1) for X in (V, mesh.V))
    return (length / rest).max()


def rod_bent(V: np.ndarray) -> np.ndarray:
    """Bend space about x = 0 along z, the first quarter of a circle of radius 4 at z = 6."""
    angle, radius = V[:, 2] * np.pi / 12, 4 - V[:, 0]
    return np.stack([4 - radius * np.cos(angle), V[:, 1], radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize("origin", [0.0, 1e4])
@pytest.mark.parametrize("mesh", [BALL, icosphere(0), t_fin()], ids=lambda mesh: f"{mesh.n}")
def test_rigid_motions_are_exact_and_at_rest_nothing_moves(mesh, origin):
    mesh = Mesh(mesh.V + origin, mesh.F)
    X = np.concatenate([around() + origin, mesh.V])
    assert move_along(mesh, mesh.V, X) == pytest.approx(X, abs=1e-14 * (10 + origin))
    R = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    moved = move_along(mesh, (mesh.V - origin) @ R.T + [1, 2, 3], X)
    assert moved == pytest.approx((X - origin) @ R.T + [1, 2, 3], abs=1e-14 * (10 + origin))


def test_cloth_between_two_balls_stretches_where_the_nearest_sample_alone_would_tear_it():
    left, right = shifted(icosphere(4), [-1.5, 0, 0]), shifted(icosphere(4), [1.5, 0, 0])
    mesh, x = beside(left, right), np.linspace(-3, 3, 301)
    y = np.array([-0.1, 0.1])
    V = np.stack([np.repeat(x, 2), np.tile(y, 301), np.full(602, 1.2)], axis=1)
    row = 2 * np.arange(300)[:, None]
    cloth = Mesh(V, np.concatenate([row + [0, 2, 1], row + [1, 2, 3]]))
    posed = mesh.V + np.repeat([[0.0, 0, 0], [0.0, 1, 0]], left.n, axis=0)
    moved = move_along(mesh, posed, V)
    assert stretch(cloth, moved) < 5  # and 50, with the nearest sample alone
    assert abs(moved[:2] - V[:2]).max() < 1e-12 and abs(moved[-2:] - V[-2:] - [0, 1, 0]).max() < 1e-12


def test_points_move_with_the_weighted_motions_of_the_samples_near_them():
    """All vertices of the ball are samples."""
    posed, X, spacing = rod_bent(BALL.V), around(20), np.sqrt(BALL.area / BALL.n)
    R = nearest_rotations(VertexMaps.at_rest(BALL)(posed)[0])
    for x, moved in zip(X, move_along(BALL, posed, X), strict=True):
        d = np.linalg.norm(x - BALL.V, axis=1)
        reach = min(BEYOND * np.sort(d)[NEAREST - 1], REACH * (d.min() + spacing))
        weight = np.maximum(1 - d / reach, 0) ** 2
        motions = np.einsum("kij,kj->ki", R, x - BALL.V) + posed
        assert moved == pytest.approx(np.average(motions, axis=0, weights=weight), abs=1e-12)


def test_more_vertices_than_samples_and_more_points_than_a_part_are_the_same_as_few():
    fine = bumpy(5)
    posed = rod_bent(fine.V)
    X = np.concatenate([fine.V, 1.1 * fine.V[:9]])
    moved = move_along(fine, DeformationResult(posed, 1, True), X)
    assert np.array_equal(move_along(fine, posed, X[-7:]), moved[-7:])
    assert abs(moved[: fine.n] - posed).max() < 0.005 * fine.diagonal


def test_no_point_is_allowed_and_one_as_far_from_all_samples_moves_with_their_mean():
    assert move_along(BALL, BALL.V, np.empty((0, 3))).shape == (0, 3)
    ball = icosphere(3)
    assert ball.n > NEAREST
    assert move_along(ball, ball.V + [0, 0, 2], np.zeros((1, 3))) == pytest.approx(np.array([[0, 0, 2.0]]))


@pytest.mark.parametrize("unit", [1e-3, 1e6])
def test_points_move_alike_in_any_unit(unit):
    """A part of the edges is very short, so that their length has to be bounded."""
    mesh = bumpy(3)
    V, posed = (np.where(np.arange(mesh.n)[:, None] < 20, 1e-4 * W + W[0], W) for W in (mesh.V, bent(mesh.V)))
    one, other = (move_along(Mesh(s * V, mesh.F), s * posed, s * 1.02 * V) / s for s in (1.0, unit))
    assert np.abs(one - other).max() < 1e-9 * mesh.diagonal
