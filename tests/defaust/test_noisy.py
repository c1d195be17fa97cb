"""The synthetic bodies as registrations: size, correlation and seeds of the noise, and exact truths."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.sources.noisy import NoisyBodies, correlated_noise
from defaust.sources.synthetic import SyntheticBodies, load_bodies
from defaust.tasks import load_task

EXACT = NoisyBodies(noise=0.0)


def displaced(source, subject, k):
    """Displacement (n, 3) of the vertices of a pose by its noise, in metres."""
    pose = source.poses(subject)[k]
    return source.posed(subject, pose).V - EXACT.posed(subject, pose).V


def test_the_noise_has_the_asked_size_and_the_rest_mesh_has_none():
    moved = 1000 * displaced(NoisyBodies(noise=3.0), 3, 1)
    assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(3.0)
    assert np.abs(moved.mean(axis=0)).max() < 0.3  # no shift of the body as a whole
    np.testing.assert_array_equal(NoisyBodies(noise=4.0).rest(7).V, SyntheticBodies().rest(7).V)


def test_the_noise_is_alike_nearby_and_independent_farther_away():
    V = load_bodies().rest[0]
    noise = np.stack([correlated_noise(V, rms=1.0, seed=[k]) for k in range(8)], axis=1)
    pairs = cKDTree(V).query_pairs(0.06, output_type="ndarray")
    distance = np.linalg.norm(V[pairs[:, 0]] - V[pairs[:, 1]], axis=1)
    product = (noise[pairs[:, 0]] * noise[pairs[:, 1]]).sum(axis=2).mean(axis=1)
    for low, high, least, most in ((0, 0.006, 0.9, 1.1), (0.013, 0.017, 0.5, 0.7), (0.05, 0.06, -0.05, 0.05)):
        assert least < product[(distance >= low) & (distance < high)].mean() < most


def test_noise_depends_on_seed_subject_and_pose():
    first = displaced(NoisyBodies(), 0, 0)
    np.testing.assert_array_equal(first, displaced(NoisyBodies(), 0, 0))
    for other in (NoisyBodies(seed=1), 0, 0), (NoisyBodies(), 1, 0), (NoisyBodies(), 0, 1):
        assert np.abs(displaced(*other) - first).max() > 1e-3


def test_the_truth_is_exact_the_handles_have_the_noise_and_the_card_says_so(tmp_path):
    source, options = NoisyBodies(noise=4.0), BuildOptions(subjects=(5,), target_vertices=None)
    build(source, tmp_path / "out", options=options, workers=1)
    task = load_task(tmp_path / "out", subject=5, pose=1)
    assert task.meta["posed_by"] == "skinning"
    moved = task.handles.dynamic
    missed = task.handles.target[moved] - task.truth[task.handles.index[moved]]
    np.testing.assert_allclose(missed, displaced(source, 5, 0)[task.handles.index[moved]], atol=1e-12)
    assert 0.002 < np.sqrt((missed**2).sum(axis=1).mean()) < 0.006
    card = (tmp_path / "out/README.md").read_text(encoding="utf-8")
    assert "4 mm of noise" in card and "as ground truth" not in card
