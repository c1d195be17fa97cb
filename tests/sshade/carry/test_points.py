"""Points that go with a mesh: exact on it and under rigid motions, and continuous between walls."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from sshade import DeformationResult, Deformer, InputError, Mesh, bind_points
from sshade.carry.points import FARTHEST
from sshade.carry.trees import LEAF, box_tree, curve_order, squared_distances, triangles_of_leaves
from tests.shapes import bent, beside, icosphere, jittered, strip

BALL = jittered(icosphere(3), 0.05)


def around(count: int = 400) -> np.ndarray:
    """Points inside of a ball, near it and on it."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * rng.uniform(0.0, 1.4, (count, 1))


def on_faces(mesh: Mesh, V: np.ndarray) -> np.ndarray:
    """A point of each face of a shape, some on sides and corners."""
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], mesh.m)
    weights[::5] = [0.5, 0.5, 0.0]
    weights[::7] = [0.0, 1.0, 0.0]
    return np.einsum("ij,ijk->ik", weights, V[mesh.F])


def wall(cells: int, height: float, seed: int) -> Mesh:
    """An irregular wall of 4 x 4 across z."""
    flat = jittered(strip(cells, cells), 0.2, seed=seed)
    return Mesh((flat.V * 4 / cells - 2) * [1, 1, 0] + [0, 0, height], flat.F)


@pytest.mark.parametrize("origin", [0.0, 1e4])
def test_rigid_motions_and_uniform_scales_are_exact(origin):
    mesh = Mesh(BALL.V + origin, BALL.F)
    X = around() + origin
    R = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    for scale in (1.0, 3.0):
        found = bind_points(mesh, X).with_maps(scale * (mesh.V - origin) @ R.T + [1, 2, 3])
        assert found.positions == pytest.approx(
            scale * (X - origin) @ R.T + [1, 2, 3], abs=1e-14 * (10 + origin)
        )
        assert abs(found.rotations - R).max() < (1e-7 if origin else 1e-12)
        assert abs(found.maps - scale * R).max() < (1e-7 if origin else 1e-12)


def test_points_on_the_surface_stay_at_their_place_on_it():
    posed = bent(BALL.V)
    moved = bind_points(BALL, on_faces(BALL, BALL.V))(posed)
    assert abs(moved - on_faces(BALL, posed)).max() < 1e-8
    assert abs(bind_points(BALL, BALL.V)(posed) - posed).max() < 1e-8


def test_maps_are_the_derivative_of_a_smooth_map():
    """The linear map approaches the derivative of a bend of space as the mesh becomes finer."""
    step, error = 1e-5, []
    for level in (3, 5):
        ball = icosphere(level)
        X = on_faces(ball, ball.V)[::7]
        found = bind_points(ball, X).with_maps(bent(ball.V))
        true = np.stack([(bent(X + e) - bent(X - e)) / (2 * step) for e in step * np.eye(3)], axis=2)
        tangential = true - np.einsum("nij,nj,nk->nik", true, X, X)
        own = found.maps - np.einsum("nij,nj,nk->nik", found.maps, X, X)
        error.append(abs(own - tangential).mean())
        assert np.linalg.det(found.rotations) == pytest.approx(np.ones(len(X)))
    assert error[1] < 0.4 * error[0] and error[1] < 0.02


@pytest.mark.parametrize(("cells", "others"), [(20, 20), (20, 5)])
def test_walls_that_slide_on_each_other_stretch_space_by_the_bound_at_most(cells, others):
    rng = np.random.default_rng(1)
    for gap in (0.005, 0.03, 0.1, 0.3, 1.0):
        one, other = wall(cells, 0.0, 0), wall(others, gap, 1)
        mesh = beside(one, other)
        posed = np.concatenate([one.V, other.V + [0.5, 0, 0]])
        z, along = np.linspace(-0.5 * gap, 1.5 * gap, 801), np.linspace(-1, 1, 2001)
        for axis, path in ((2, z), (0, along), (1, along)):
            X = np.repeat(rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, gap], (10, 3))[:, None], len(path), axis=1)
            X[:, :, axis] = path
            moved = bind_points(mesh, X.reshape(-1, 3))(posed).reshape(X.shape) - X
            assert abs(moved[:, :, 1:]).max() < 1e-9
            slope = abs(np.diff(moved[:, :, 0], axis=1)).max() / (path[1] - path[0])
            assert slope <= 4 * 0.5 / gap
        assert moved.max() <= 0.5 + 1e-9 and moved.min() >= -1e-9


@pytest.mark.parametrize(("levels", "ratio"), [((3, 3), 1.02), ((3, 4), 1.1), ((4, 3), 1.3), ((3, 4), 1.3)])
def test_nested_spheres_that_move_apart_stretch_space_by_the_bound_at_most(levels, ratio):
    """Walls whose normals agree: their samples must stay apart although the gap is narrow."""
    one, other = (icosphere(level) for level in levels)
    mesh = beside(one, Mesh(ratio * other.V, other.F))
    posed = np.concatenate([one.V, ratio * other.V + [0.2, 0, 0]])
    direction = np.random.default_rng(0).normal(size=(60, 1, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    radii = np.linspace(1.5 - 0.5 * ratio, 1.5 * ratio - 0.5, 601)
    X = direction * radii[:, None]
    moved = bind_points(mesh, X.reshape(-1, 3))(posed).reshape(X.shape) - X
    slope = np.linalg.norm(np.diff(moved, axis=1), axis=2).max() / (radii[1] - radii[0])
    assert 2 * 0.2 / (ratio - 1) < slope <= 4 * 0.2 / (ratio - 1)


def test_nothing_jumps_around_a_bent_ball():
    posed, rng = bent(BALL.V), np.random.default_rng(2)
    ends = around(20).reshape(10, 2, 3)
    fraction = np.linspace(0, 1, 4001)[:, None]
    paths = ends[:, :1] * (1 - fraction) + ends[:, 1:] * fraction
    moved = bind_points(BALL, paths.reshape(-1, 3))(posed).reshape(paths.shape)
    step = np.linalg.norm(np.diff(moved, axis=1), axis=2) / np.linalg.norm(np.diff(paths, axis=1), axis=2)
    assert step.max() < 6
    order = rng.permutation(len(paths.reshape(-1, 3)))
    again = bind_points(BALL, paths.reshape(-1, 3)[order])(posed)
    assert again == pytest.approx(moved.reshape(-1, 3)[order], abs=1e-7)


def test_triangles_without_area_and_poses_without_area_are_allowed():
    V = np.concatenate([BALL.V, BALL.V[:1], BALL.V[:1]])
    F = np.concatenate([BALL.F, [[0, BALL.n, BALL.n + 1]]])
    bound = bind_points(Mesh(V, F), around())
    assert np.isfinite(bound(V)).all() and abs(bound(V) - around()).max() < 1e-12
    flat = bound.with_maps(V * [1, 1, 0])
    assert np.isfinite(flat.positions).all() and np.isfinite(flat.rotations).all()


def test_a_deformer_and_its_result_are_taken():
    index = np.array([0, 100, 300])
    deformer = Deformer(BALL, index, vertices=60)
    result = deformer(BALL.V[index] + [0, 0, 0.1])
    assert isinstance(result, DeformationResult)
    bound, out = bind_points(deformer, around()), np.empty((400, 3))
    assert bound(result, out=out) is out and (out == bound(result.vertices)).all() and len(bound) == 400


def test_no_points_are_allowed():
    found = bind_points(BALL, np.empty((0, 3))).with_maps(BALL.V)
    assert found.positions.shape == (0, 3) and found.maps.shape == found.rotations.shape == (0, 3, 3)


def test_bad_points_and_poses_are_refused():
    with pytest.raises(InputError, match="array, not one of shape"):
        bind_points(BALL, np.zeros(3))
    with pytest.raises(InputError, match="point 1 has a NaN"):
        bind_points(BALL, [[0, 0, 0], [np.nan, 0, 0]])
    far = (FARTHEST + 0.01) * BALL.diagonal
    for X in ([0, 0, 1 + far], [0, 0, 9.0]):
        with pytest.raises(InputError, match=r"1 of 2 points are too far .* point 1 by"):
            bind_points(BALL, [[0, 0, 1], X])
    with pytest.raises(InputError, match="pose has shape"):
        bind_points(BALL, around())(BALL.V[1:])
    with pytest.raises(InputError, match="NaN"):
        bind_points(BALL, around())(np.full_like(BALL.V, np.nan))
    with pytest.raises(InputError, match="no face of the mesh has an area"):
        bind_points(Mesh(np.arange(3.0)[:, None] * [1, 0, 0], [[0, 1, 2]]), np.zeros((1, 3)))


def test_distances_from_triangles_are_those_of_dense_points_on_them():
    """Also from needles, and at corners, sides and inner points of triangles."""
    rng = np.random.default_rng(4)
    corners = rng.normal(size=(30, 3, 3))
    corners[::5, 2] = corners[::5, 0] + 0.3 * (corners[::5, 1] - corners[::5, 0]) + 1e-9
    u = np.linspace(0, 1, 201)
    s, t = (part.ravel() for part in np.meshgrid(u, u))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    X = np.concatenate(
        [3 * rng.normal(size=(100, 3)), corners[:20].reshape(-1, 3), corners[:20].mean(axis=1)]
    )
    sides = corners[:, 1:] - corners[:, :1]
    dense = np.concatenate(
        [corners[:, 0] + a * sides[:, 0] + b * sides[:, 1] for a, b in zip(s, t, strict=True)]
    )
    expected = cKDTree(dense).query(X)[0]
    order = curve_order(corners.mean(axis=1))
    tree = box_tree(corners[order].min(axis=1), corners[order].max(axis=1), leaf=LEAF)
    found = np.empty(len(X))
    squared_distances(0, len(X), X, triangles_of_leaves(corners[order]), tree, found)
    assert (np.sqrt(found) <= expected + 1e-12).all() and (np.sqrt(found) >= expected - 0.03).all()
    assert np.sqrt(found[100:]).max() < 1e-7
