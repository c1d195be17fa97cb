"""The Kabsch algorithm compared with scipy, and points that do not determine the rotation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sshade.mesh.rigid import common_motion, rigid_motion
from tests.shapes import icosphere, rotation


def proper(R: np.ndarray) -> bool:
    return np.allclose(R @ R.T, np.eye(3), atol=1e-13) and np.linalg.det(R) > 0


@given(seed=st.integers(0, 10_000), count=st.integers(3, 8))
def test_kabsch_equals_scipys_alignment(seed, count):
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, count, 3))
    target = target if seed % 2 else source @ rotation(seed).T + target[0]  # a rigid motion for even seeds
    R, t = rigid_motion(source, target)
    assert proper(R)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    reference = Rotation.align_vectors(b, a)[0].as_matrix()
    gap, best = np.linalg.norm(source @ R.T + t - target), np.linalg.norm(a @ reference.T - b)
    assert gap <= best * (1 + 1e-12) + 1e-12
    assert np.allclose(R, reference, atol=1e-6)


def test_kabsch_of_points_on_a_line_is_the_smallest_rotation():
    line = np.linspace(-1, 1, 5)[:, None]
    for a, b in ([[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [0.6, 0, 0.8]]):
        a, b = np.array(a, dtype=float), np.array(b, dtype=float)
        R, t = rigid_motion(line * a + 2, line * b - 1)
        assert proper(R) and np.allclose(R @ a, b, atol=1e-13)
        assert Rotation.from_matrix(R).magnitude() == pytest.approx(np.arccos(a @ b))
        assert np.allclose((line * a + 2) @ R.T + t, line * b - 1, atol=1e-13)
    R, t = rigid_motion(np.ones((4, 3)), np.arange(12.0).reshape(4, 3))  # one place
    assert np.array_equal(R, np.eye(3)) and np.allclose(t, np.arange(12.0).reshape(4, 3).mean(axis=0) - 1)
    turned, _ = rigid_motion(line * [0.0, 0.6, 0.8], -line * [0.0, 0.6, 0.8])
    assert proper(turned) and np.allclose(turned @ [0, 0.6, 0.8], [0, -0.6, -0.8], atol=1e-13)


def test_points_with_a_common_motion():
    P, R, t = icosphere(1).V, rotation(2), np.array([3.0, -1, 20])
    for Q in (P + t, P @ R.T + t, P.astype(np.float32) @ R.T.astype(np.float32) + t):
        found, shift = common_motion(P, Q)
        assert np.abs(P @ found.T + shift - Q).max() < 1e-6
    found, shift = common_motion(P[:1], P[:1] + t)
    assert np.array_equal(found, np.eye(3)) and np.allclose(shift, t)
    line = np.outer(np.arange(5.0), [1, 2, 3])
    assert np.array_equal(common_motion(line, line + t)[0], np.eye(3))


def test_points_without_one_or_with_several():
    P, R = icosphere(1).V, rotation(2)
    bent, mirrored, line = P.copy(), P * [1, 1, -1], np.outer(np.arange(5.0), [1, 2, 3])
    bent[0] *= 1 + 1e-5
    narrow = P * [1, 0.01, 0.01]
    for source, target in ((P, bent), (P, mirrored), (line, line @ R.T), (narrow, narrow @ R.T)):
        assert common_motion(source, target) is None
