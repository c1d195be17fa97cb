import igl
import numpy as np
import pytest

from sshade import Mesh
from sshade.proxy.projection import Projection
from sshade.proxy.triangle import TriangleFrames, frame_values
from tests.shapes import bent, block, bumpy, jittered, rotation, strip

BODY = bumpy(2)
#: Length of the gradient of f below which f_2 replaces f.
FLAT = 0.1


def igl_gradients(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """(m, 3) tangential gradient of one value a vertex on each triangle."""
    G = igl.grad(np.array(mesh.V), np.array(mesh.F))
    return np.asarray((G @ values).reshape(3, mesh.m).T)


def at(face) -> Projection:
    """Points at the barycentres of triangles."""
    face = np.asarray(face)
    return Projection(face, np.full((len(face), 3), 1 / 3))


def test_g_is_the_normalised_gradient_n_the_normal_and_w_their_product():
    axis = np.argmin(np.abs(BODY.face_normals), axis=1)
    frames = TriangleFrames.of_values(BODY, BODY.V[BODY.F, axis[:, None]])
    every = np.stack([igl_gradients(BODY, x) for x in BODY.V.T], axis=1)
    gradients = every[np.arange(BODY.m), axis]
    g, w, n = frames.L.transpose(2, 0, 1)
    assert np.allclose(g, gradients / np.linalg.norm(gradients, axis=1, keepdims=True), rtol=0, atol=1e-12)
    assert np.allclose(n, BODY.face_normals, rtol=0, atol=1e-13)
    assert np.allclose(w, np.cross(g, n), rtol=0, atol=1e-14)
    assert np.allclose(frames.origin, BODY.V[BODY.F].mean(axis=1), rtol=0, atol=1e-15)
    assert not frames.degenerate.any()
    assert not TriangleFrames.at_rest(Mesh(BODY.V * 1e-30, BODY.F)).degenerate.any()
    for height, degenerate in ((1e-13, True), (1e-10, False)):
        needle = Mesh([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0]], [[0, 1, 2]])
        assert TriangleFrames.of_values(needle, np.array([[0.0, 1, 0.5]])).degenerate.all() == degenerate


@pytest.mark.parametrize(("given", "axis", "second"), [(None, 2, 1), (2, 2, 1), (0, 0, 2), (1, 1, 2)])
def test_a_coordinate_gives_way_exactly_where_its_gradient_is_under_the_threshold(given, axis, second):
    # The block is longest along z and shortest along x. The jitter tilts some normals of the sides by more
    # than the threshold, others by less.
    mesh = jittered(block(np.ones((2, 3, 5)), cells=2), 0.03)
    order = np.argsort(-np.ptp(mesh.V, axis=0))
    assert order.tolist() == [2, 1, 0]
    length = np.linalg.norm(igl_gradients(mesh, mesh.V[:, axis]), axis=1)
    flat = length < FLAT
    assert flat.any() and not flat.all() and np.abs(length - FLAT).min() > 1e-9
    expected = np.where(flat[:, None], mesh.V[mesh.F, second], mesh.V[mesh.F, axis])
    assert np.array_equal(frame_values(mesh, given), expected)
    replaced = TriangleFrames.of_values(mesh, expected)
    if given is None:
        assert np.array_equal(TriangleFrames.at_rest(mesh).L, replaced.L)
    gradient = igl_gradients(mesh, mesh.V[:, second])[flat]
    g = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.allclose(replaced.L[flat, :, 0], g, rtol=0, atol=1e-10)


def collapsed(mesh: Mesh, face: int, NV: np.ndarray) -> np.ndarray:
    """Return NV with the third corner of a face moved to the middle of the other two corners."""
    NV = NV.copy()
    a, b, c = mesh.F[face]
    NV[c] = 0.5 * (NV[a] + NV[b])
    return NV


def assert_mean_turn(frames: TriangleFrames, face: int, NV: np.ndarray) -> None:
    """Assert that a triangle turns by the rotation nearest to the sum of its edge neighbours' rotations."""
    deformed = TriangleFrames.of_values(Mesh(NV, frames.F), frames.values)
    missing = frames.degenerate | deformed.degenerate
    on = at(np.full(4, face))
    points = frames.origin[face] + np.concatenate([np.zeros((1, 3)), np.eye(3)])
    moved, count = frames.decode(frames.encode(points, on), NV, on=on)
    assert missing[face] and count == missing.sum()
    beside = np.flatnonzero((np.isin(frames.F, frames.F[face]).sum(axis=1) == 2) & ~missing)
    U, _, Vt = np.linalg.svd(sum(deformed.L[t] @ frames.L[t].T for t in beside))
    turn = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    assert np.allclose((moved[1:] - moved[0]).T, turn, rtol=0, atol=1e-9)
    assert np.allclose(moved[0], NV[frames.F[face]].mean(axis=0), rtol=0, atol=1e-12)


def test_zero_area_triangles_turn_like_the_mean_of_their_neighbours():
    frames = TriangleFrames.at_rest(BODY)
    assert_mean_turn(frames, 30, collapsed(BODY, 30, bent(BODY.V) @ rotation(4).T))
    sheet = strip(4, 3)
    for face in (8, 9):  # onto an edge along x, where f stays constant, and onto a diagonal
        at_rest = TriangleFrames.at_rest(Mesh(collapsed(sheet, face, sheet.V), sheet.F))
        assert_mean_turn(at_rest, face, bent(sheet.V) @ rotation(5).T)
