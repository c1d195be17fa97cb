from __future__ import annotations

import igl
import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.carry.projection import Projection
from sshade.carry.triangle import TriangleFrames, frame_values
from tests.shapes import bent, block, bumpy, icosphere, jittered, rotation, strip

BODY = bumpy(2)
#: Where the gradient of f is shorter, f_2 takes over.
FLAT = 0.1


def igl_gradients(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """(m, 3) tangential gradient of one value a vertex on each triangle."""
    G = igl.grad(np.array(mesh.V), np.array(mesh.F))
    return np.asarray((G @ values).reshape(3, mesh.m).T)


def at(face) -> Projection:
    """Points at the barycentres of triangles."""
    face = np.asarray(face)
    return Projection(face, np.full((len(face), 3), 1 / 3), np.zeros(len(face)))


def test_g_is_the_normalised_gradient_n_the_normal_and_w_their_product():
    frames = TriangleFrames.at_rest(BODY, "best")
    axis = np.argmin(np.abs(BODY.face_normals), axis=1)
    every = np.stack([igl_gradients(BODY, x) for x in BODY.V.T], axis=1)
    gradients = every[np.arange(BODY.m), axis]
    g, w, n = frames.L.transpose(2, 0, 1)
    assert np.allclose(g, gradients / np.linalg.norm(gradients, axis=1, keepdims=True), rtol=0, atol=1e-12)
    assert np.allclose(n, BODY.face_normals, rtol=0, atol=1e-13)
    assert np.allclose(w, np.cross(g, n), rtol=0, atol=1e-14)
    assert np.allclose(frames.origin, BODY.V[BODY.F].mean(axis=1), rtol=0, atol=1e-15)
    assert not frames.degenerate.any()


def test_best_takes_the_coordinate_of_largest_gradient_which_is_never_small():
    lengths = np.stack([np.linalg.norm(igl_gradients(BODY, x), axis=1) for x in BODY.V.T], axis=1)
    assert np.allclose((lengths**2).sum(axis=1), 2.0)
    assert lengths.max(axis=1).min() >= np.sqrt(2 / 3) - 1e-12
    chosen = frame_values(BODY, "best")
    expected = BODY.V[BODY.F][np.arange(BODY.m), :, np.argmax(lengths, axis=1)]
    assert np.array_equal(chosen, expected)


@pytest.mark.parametrize(
    ("function", "axis", "second"), [("extent", 2, 1), ("z", 2, 1), ("x", 0, 2), ("y", 1, 2)]
)
def test_a_coordinate_gives_way_exactly_where_its_gradient_is_under_the_threshold(function, axis, second):
    # Longest along z, then y; the jitter tilts the sides' normals by more and by less than the threshold.
    mesh = jittered(block(np.ones((2, 3, 5)), cells=2), 0.03)
    order = np.argsort(-np.ptp(mesh.V, axis=0))
    assert order.tolist() == [2, 1, 0]
    length = np.linalg.norm(igl_gradients(mesh, mesh.V[:, axis]), axis=1)
    flat = length < FLAT
    assert flat.any() and not flat.all() and np.abs(length - FLAT).min() > 1e-9
    expected = np.where(flat[:, None], mesh.V[mesh.F, second], mesh.V[mesh.F, axis])
    assert np.array_equal(frame_values(mesh, function), expected)
    replaced = TriangleFrames.at_rest(mesh, function)
    gradient = igl_gradients(mesh, mesh.V[:, second])[flat]
    g = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.allclose(replaced.L[flat, :, 0], g, rtol=0, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_given_values_are_scaled_by_range_over_diagonal_before_the_threshold(scale):
    f = np.maximum(BODY.V[:, 2], 0) + 0.02 * BODY.V[:, 0]
    unit = f * BODY.diagonal / np.ptp(f)
    length = np.linalg.norm(igl_gradients(BODY, unit), axis=1)
    flat = length < FLAT
    assert flat.any() and not flat.all() and np.abs(length - FLAT).min() > 1e-6
    values = frame_values(BODY, scale * f)
    assert np.array_equal(values[flat], frame_values(BODY, "best")[flat])
    assert np.allclose(values[~flat], unit[BODY.F[~flat]], rtol=1e-12)


def test_a_constant_function_is_refused():
    with pytest.raises(InputError, match="constant"):
        frame_values(BODY, np.ones(162))


def test_a_stretch_along_g_scales_no_tangential_coordinate():
    """With the raw gradient in L, a stretch by 1.3 would come out as a shrinking by 1.3."""
    sheet = strip(4, 3)
    frames = TriangleFrames.at_rest(sheet, "x")
    assert np.allclose(frames.L[:, :, 0], [1, 0, 0])
    face = np.arange(sheet.m)
    offset = np.array([0.2, -0.1, 0.05])
    points = frames.origin + offset
    stretched = sheet.V * [1.3, 1, 1]
    moved, _ = frames.decode(frames.encode(points, at(face)), stretched, on=at(face))
    barycentres = stretched[sheet.F].mean(axis=1)
    assert np.allclose(moved - barycentres, offset, rtol=0, atol=1e-14)


def test_the_choice_of_f_is_kept_on_the_deformed_proxy():
    # Turned by a quarter, z is flat where it was steep; the rest choice still gives the rigid motion.
    mesh = block(np.ones((2, 3, 5)), cells=2)
    frames = TriangleFrames.at_rest(mesh, "extent")
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    points, face = np.random.default_rng(2).normal(size=(mesh.m, 3)), np.arange(mesh.m)
    moved, _ = frames.decode(frames.encode(points, at(face)), mesh.V @ turn.T, on=at(face))
    assert np.allclose(moved, points @ turn.T, rtol=0, atol=1e-13 * mesh.diagonal)


def collapsed(mesh: Mesh, faces: list[int], NV: np.ndarray) -> np.ndarray:
    """Deformed vertices with the third corner of each face put onto the middle of its other two."""
    NV = NV.copy()
    for f in faces:
        a, b, c = mesh.F[f]
        NV[c] = 0.5 * (NV[a] + NV[b])
    return NV


def map_of(frames: TriangleFrames, face: int, NV: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Of the map of one triangle: linear part and image of the barycentre; and the count without area."""
    on = at(np.full(4, face))
    points = frames.origin[face] + np.concatenate([np.zeros((1, 3)), np.eye(3)])
    moved, count = frames.decode(frames.encode(points, on), NV, on=on)
    return (moved[1:] - moved[0]).T, moved[0], count


def mean_turn(frames: TriangleFrames, face: int, NV: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """The rotation nearest to the sum of those of the edge neighbours that have one."""
    L = TriangleFrames.of_values(Mesh(NV, frames.F), frames.values).L
    shared = np.isin(frames.F, frames.F[face]).sum(axis=1)
    beside = np.flatnonzero((shared == 2) & ~missing)
    U, _, Vt = np.linalg.svd(sum(L[t] @ frames.L[t].T for t in beside))
    return U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt


def test_zero_area_triangles_are_counted_and_turn_as_their_neighbours_in_the_mean():
    frames = TriangleFrames.at_rest(BODY, "best")
    NV = collapsed(BODY, [30], bent(BODY.V) @ rotation(4).T)
    missing = TriangleFrames.of_values(Mesh(NV, BODY.F), frames.values).degenerate
    assert missing[30]
    turn, at, count = map_of(frames, 30, NV)
    assert count == missing.sum()
    assert np.allclose(turn, mean_turn(frames, 30, NV, missing), rtol=0, atol=1e-12)
    assert np.allclose(at, NV[BODY.F[30]].mean(axis=0), rtol=0, atol=1e-13 * BODY.diagonal)


def test_triangles_without_area_at_rest_turn_so_too_whatever_they_become():
    sheet = strip(4, 3)
    rest = Mesh(collapsed(sheet, [8], sheet.V), sheet.F)
    frames = TriangleFrames.at_rest(rest, "best")
    assert frames.degenerate[8]
    NV = bent(sheet.V) @ rotation(5).T
    deformed = TriangleFrames.of_values(Mesh(NV, sheet.F), frames.values)
    turn, _, count = map_of(frames, 8, NV)
    assert count == (frames.degenerate | deformed.degenerate).sum() >= 1
    assert np.allclose(turn, mean_turn(frames, 8, NV, frames.degenerate), rtol=0, atol=1e-12)


def test_the_mean_of_neighbours_is_a_rotation_also_where_they_fold_over():
    """Half turns about three axes add up to minus the identity, which is no rotation."""
    V = [[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, -2, 0], [3, 2, 0], [-1, 2, 0]]
    fan = Mesh(np.array(V, dtype=float), [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5]])
    frames = TriangleFrames.at_rest(fan, "x")
    reflected = 0
    for seed in range(40):
        NV = collapsed(fan, [0], np.random.default_rng(seed).normal(size=(6, 3)))
        L = TriangleFrames.of_values(Mesh(NV, fan.F), frames.values).L
        reflected += np.linalg.det(sum(L[t] @ frames.L[t].T for t in (1, 2, 3))) < 0
        turn, _, _ = map_of(frames, 0, NV)
        assert np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert reflected > 0


def test_patches_of_zero_area_triangles_are_filled_from_their_rim():
    turn, shift = rotation(5), np.array([1.0, 2, 3])
    frames = TriangleFrames.at_rest(BODY)
    NV = BODY.V @ turn.T + shift
    ring = np.unique(BODY.F[(BODY.F == 20).any(axis=1)])
    NV[ring] = NV[20]
    face = np.arange(BODY.m)
    local = frames.encode(frames.origin + [0.1, 0, 0], at(face))
    moved, count = frames.decode(local, NV, on=at(face))
    inside = np.isin(BODY.F, ring).sum(axis=1) >= 2
    assert count == inside.sum() > 6
    assert np.isfinite(moved).all()
    # Every frame is a rotation of the rest frame, so that offsets keep their length.
    offsets = moved - NV[BODY.F].mean(axis=1)
    assert np.allclose(np.linalg.norm(offsets, axis=1), 0.1, rtol=1e-12)


def test_a_proxy_without_any_frame_keeps_its_points_unturned():
    mesh = icosphere(0)
    frames = TriangleFrames.at_rest(mesh)
    face = np.arange(mesh.m)
    points = frames.origin + [0.0, 0.1, 0.0]
    moved, count = frames.decode(frames.encode(points, at(face)), np.ones((mesh.n, 3)), on=at(face))
    assert count == mesh.m
    assert np.allclose(moved, [1.0, 1.1, 1.0], rtol=0, atol=1e-15)


def test_degeneracy_is_relative_to_the_triangle():
    """A tiny triangle has a frame; a needle of no relative height has none."""
    tiny = Mesh(BODY.V * 1e-30, BODY.F)
    assert not TriangleFrames.at_rest(tiny, "best").degenerate.any()
    needle = Mesh([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-13, 0]], [[0, 1, 2]])
    assert TriangleFrames.of_values(needle, np.array([[0.0, 1, 0.5]])).degenerate.all()
    thin = Mesh([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-10, 0]], [[0, 1, 2]])
    assert not TriangleFrames.of_values(thin, np.array([[0.0, 1, 0.5]])).degenerate.any()
