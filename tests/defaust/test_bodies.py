"""The bodies of the package: their assets, their skinning, the tools that baked them, and true poses."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.sources.animals import Animals
from defaust.sources.new_bodies import NewBodies
from defaust.sources.noisy import NoisyBodies
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import read_asset
from defaust.sources.synthetic import SHA256, SyntheticBodies
from defaust.tasks import load_task
from tests.defaust.toy import change
from tests.full import few
from tools.bake.bodies import add_poses, without_reaches

BODIES, NEW = SyntheticBodies(), NewBodies()
#: Sources, each with a subject and the steps of subdivision.
BUILT = {"new": (NEW, 12, 0), "noisy": (NoisyBodies(noise=4.0), 5, 0), "animals": (Animals(), 1, 1)}


@pytest.mark.parametrize("subject", few([*BODIES.subjects, *NEW.subjects], 4, 12))
def test_bodies_are_closed_and_in_correspondence(subject):
    source = BODIES if subject in BODIES.subjects else NEW
    rest, *posed = [source.rest(subject), *(source.posed(subject, pose) for pose in source.poses(subject))]
    assert 1.4 < np.ptp(rest.V[:, 1]) < 1.95
    crossed = [self_intersecting(mesh).mean() for mesh in (rest, *posed)]
    assert crossed[0] == 0 and max(crossed) < 0.05
    if source is BODIES:  # the first four poses touch nothing
        assert max(crossed[:5]) == 0 and np.count_nonzero(crossed[5:]) >= 5
    for mesh in (rest, *posed):
        assert (mesh.n, mesh.m) == (6890, 13776) and mesh.topology == (2, 1, 0)
        assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented
        assert 0.04 < mesh.volume < 0.1 and abs(mesh.volume / rest.volume - 1) < 0.08
        assert mesh.face_areas.min() > 1e-8
        assert mesh.V[:, 1].min() == pytest.approx(0.0, abs=2e-4) or mesh is not rest
        np.testing.assert_array_equal(mesh.F, BODIES.rest(0).F)
    assert source.landmark_vertices(subject) == BODIES.landmark_vertices(0)


def test_bones_follow_the_chain_and_a_twist_does_not_collapse():
    joints, half_turn = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.pi - 1e-9
    motions = bone_motions(joints, np.array([-1, 0]), rotations=np.array([[0, 0, np.pi / 2]] * 2))
    # The elbow moves to (0, 1, 0); the point one unit beyond it turns by half a turn.
    np.testing.assert_allclose(apply_motions(motions[[1]], np.array([[2.0, 0, 0]])), [[-1, 1, 0]], atol=1e-15)
    # The mean of no rotation and a half turn is a quarter turn; linear blending would give radius 0.
    motions = bone_motions(0 * joints, np.array([-1, 0]), rotations=np.array([[0, 0, 0], [half_turn, 0, 0]]))
    blended = blend_motions(motions, bone=np.array([[0, 1]]), weight=np.full((1, 2), 0.5))
    np.testing.assert_allclose(apply_motions(blended, np.array([[0.5, 1.0, 0]])), [[0.5, 0, 1]], atol=1e-8)


@pytest.mark.full
def test_the_shipped_poses_can_be_baked_again_from_the_shipped_bodies():
    arrays = read_asset("bodies", sha256=SHA256)
    first = arrays | {name: arrays[name][:1] for name in ("offset", "joints", "rotations", "shifts")}
    again = add_poses(without_reaches(first))
    assert again.keys() == arrays.keys()
    np.testing.assert_array_equal(again["pose_names"], arrays["pose_names"])
    for name in ("rotations", "shifts"):
        np.testing.assert_allclose(again[name], first[name], atol=1e-4)


@pytest.mark.parametrize("name", few(BUILT, "noisy"))
def test_a_build_is_sound_and_high_and_low_resolution_have_one_true_pose(name, tmp_path):
    source, subject, steps = BUILT[name]
    options = BuildOptions(subjects=(subject,), target_vertices=8000, ls3_steps=steps)
    build(source, tmp_path / "out", options=options, workers=1)
    assert verify(tmp_path / "out") == []
    exact = NoisyBodies(noise=0.0) if isinstance(source, NoisyBodies) else source
    for k, pose in list(enumerate(source.poses(subject), start=1))[::3]:
        high = load_task(tmp_path / "out", subject=subject, pose=k)
        low = load_task(tmp_path / "out", subject=subject, pose=k, resolution="low")
        np.testing.assert_allclose(low.truth, exact.posed(subject, pose).V, atol=1e-12)
        assert high.meta["posed_by"] == "skinning" and high.meta["n_dynamic"] >= 30
        # Nearest vertices at rest stay near each other.
        gap, nearest = cKDTree(high.mesh.V).query(low.mesh.V)
        there = np.linalg.norm(high.truth[nearest] - low.truth, axis=1)
        assert gap.mean() < 0.01 and there.mean() < 2 * gap.mean() + 1e-4 * low.mesh.diagonal
    change(tmp_path / "out", lambda document: document["source"].update(asset_sha256="0" * 64))
    task = load_task(tmp_path / "out", subject=subject, pose=1)
    assert task.truth is None and "of another version (asset 000000000000)" in task.meta["no_truth"]
