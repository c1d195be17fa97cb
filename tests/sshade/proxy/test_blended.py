"""Frames at the proxy's vertices, blended over its triangles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import InputError, Mesh, bind
from sshade.proxy.blended import BlendedFrames, nearest_rotations
from sshade.proxy.projection import Projection
from sshade.proxy.vertex_maps import VertexMaps
from tests.shapes import bent, bumpy, family, rotation

MESHES = family()


def points_on(mesh: Mesh, count: int) -> Projection:
    """Random points in random triangles."""
    rng = np.random.default_rng(0)
    return Projection(rng.integers(0, mesh.m, count), rng.dirichlet([1, 1, 1], count))


def turns(count: int, *, most: float, seed: int = 0) -> np.ndarray:
    """(count, 3, 3) rotations about random axes by up to `most` radians."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Rotation.from_rotvec(axes * rng.uniform(0, most, (count, 1))).as_matrix()


def half_way(R: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose in the middle of the screw motion from one pose to another.

    The whole motion is x -> turn x + shift. The half motion, applied twice, gives the whole motion.
    """
    turn = R[1] @ R[0].T
    shift = v[1] - turn @ v[0]
    half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(turn).as_rotvec()).as_matrix()
    return half @ R[0], half @ v[0] + np.linalg.solve(half + np.eye(3), shift)


def one_by_one(
    proxy: Mesh, V: np.ndarray, *, on: Projection, NV: np.ndarray, R: np.ndarray, S: np.ndarray
) -> np.ndarray:
    """Evaluate blended frames point by point from the definition; S stretches frames at vertices."""
    moved = np.empty_like(V)
    for i, (t, w) in enumerate(zip(on.face, on.barycentric, strict=True)):
        corners = proxy.F[t]
        o = w @ NV[corners]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            ends = corners[[a, b]]
            turn, middle = half_way(R[ends], NV[ends])
            e = proxy.V[ends[1]] - proxy.V[ends[0]]
            bulge = 4 * (middle - NV[ends].mean(axis=0))
            o += w[a] * w[b] * (bulge + 0.5 * turn @ (S[ends[0]] - S[ends[1]]) @ e)
        q = Rotation.from_matrix(R[corners]).as_quat()
        turn = Rotation.from_quat(w @ (q * np.where(q @ q[0] < 0, -1.0, 1.0)[:, None])).as_matrix()
        moved[i] = o + turn @ np.einsum("c,cxy->xy", w, S[corners]) @ (V[i] - w @ proxy.V[corners])
    return moved


def collapsed_and_turned(proxy: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return N' with 20 neighbouring vertices at one place, after a turn; and the turn (3, 3)."""
    NV, turn = proxy.V @ rotation(5).T, rotation(5)
    near = np.argsort(np.linalg.norm(proxy.V - proxy.V[20], axis=1))[:20]
    NV[near] = NV[20]
    return NV, turn


@pytest.mark.parametrize("name", MESHES)
def test_samples_go_where_their_proxy_vertices_go_to_the_last_bit(name):
    mesh = MESHES[name]
    binding = bind(mesh, mesh.n // 6, frames="blended")
    NV = bent(binding.proxy.V, 0.5) @ rotation(2).T
    assert np.array_equal(binding.carry(NV)[0][binding.sampling.samples], NV)


def test_decoding_follows_the_definition():
    proxy = bumpy(1)
    on, rng = points_on(proxy, 60), np.random.default_rng(1)
    V = np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]]) + 0.1 * rng.normal(size=(60, 3))
    NV = bent(proxy.V, 0.5) @ rotation(3).T
    R, unit = turns(proxy.n, most=0.9), np.broadcast_to(np.eye(3), (proxy.n, 3, 3))
    frames, fitted = BlendedFrames(proxy), nearest_rotations(VertexMaps.at_rest(proxy)(NV)[0])
    for given, used in ((R, R), (None, fitted)):
        moved, missing = frames.decode(frames.encode(V, on), NV, on=on, rotations=given)
        assert missing == 0
        expected = one_by_one(proxy, V, on=on, NV=NV, R=used, S=unit)
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12)


def test_opposite_quaternions_of_nearly_equal_rotations_do_not_cancel():
    """Two corners have half turns about nearly the same axis.

    Both half turns are equally far from the rotation of the third corner.
    """
    triangle = Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    half = Rotation.from_rotvec(np.pi * np.array([[1, -0.999, 0], [1, -1.001, 0]]) / np.sqrt(2)).as_matrix()
    half = 2 * np.round((half + np.eye(3)) / 2, 12) - np.eye(3)
    R = np.concatenate([np.eye(3)[None], half])
    on = Projection(np.zeros(1, dtype=np.int64), np.array([[0.0, 0.5, 0.5]]))
    frames = BlendedFrames(triangle)
    offset = np.array([[0.3, -0.4, 0.5]])
    moved, _ = frames.decode(offset, triangle.V, on=on, rotations=R)
    expected = [0.5, 0.5, 0] + half.mean(axis=0) @ offset[0]
    np.testing.assert_allclose(moved[0], expected, rtol=0, atol=2e-3)


def test_collapsed_parts_of_the_proxy_are_counted():
    binding = bind(bumpy(3), 100, frames="blended")
    NV, turn = collapsed_and_turned(binding.proxy)
    V, missing = binding.carry(NV)
    assert 0 < missing < 20 and np.isfinite(V).all()
    assert binding.carry(NV, rotations=np.broadcast_to(turn, (binding.proxy.n, 3, 3)))[1] == 0


def test_rotations_that_do_not_fit_are_refused():
    binding = bind(bumpy(2), 40, frames="blended")
    NV, unit = binding.proxy.V, np.tile(np.eye(3), (binding.proxy.n, 1, 1))
    with pytest.raises(InputError, match=r"needs rotations of shape \(\d+, 3, 3\), not \(3, 3\)"):
        binding.carry(NV, rotations=np.eye(3))
    for wrong in (np.diag([1.0, 1, -1]), 1.001 * np.eye(3), np.full((3, 3), np.nan), np.zeros((3, 3))):
        unit[-1] = wrong
        with pytest.raises(InputError, match="it is no rotation"):
            binding.carry(NV, rotations=unit)
