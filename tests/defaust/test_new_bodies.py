"""The new bodies: their asset, the tool that baked it, and tasks made from them."""

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.sources.new_bodies import NewBodies, load_new_bodies
from defaust.sources.synthetic import SyntheticBodies
from defaust.tasks import load_task
from tools.bake import new_bodies
from tools.bake.noisy import make_pose

SOURCE = NewBodies()


@pytest.mark.parametrize("subject", SOURCE.subjects)
def test_new_bodies_are_closed_and_have_the_template_and_landmarks_of_the_bodies(subject):
    rest, *posed = [SOURCE.rest(subject), *(SOURCE.posed(subject, pose) for pose in SOURCE.poses(subject))]
    assert len(posed) == 6 and not self_intersecting(rest).any()
    assert 1.4 < np.ptp(rest.V[:, 1]) < 1.95
    for mesh in (rest, *posed):
        np.testing.assert_array_equal(mesh.F, SyntheticBodies().rest(0).F)
        assert mesh.V[:, 1].min() == pytest.approx(0.0, abs=2e-4)
        assert abs(mesh.volume / rest.volume - 1) < 0.08
        assert mesh.face_areas.min() > 1e-8
        assert self_intersecting(mesh).mean() < 0.011
    assert SOURCE.landmark_vertices(subject) == SyntheticBodies().landmark_vertices(0)


def test_a_pose_of_the_new_bodies_can_be_baked_again():
    bodies = load_new_bodies()
    assert list(new_bodies.NEW["poses"]) == list(bodies.pose_names)
    k = bodies.pose_names.index("crawling")
    pose, seed = new_bodies.NEW["poses"]["crawling"], [new_bodies.SEED, SOURCE.subjects[1], k]
    rotations, shift = make_pose(bodies, subject=1, pose=pose, seed=seed)
    np.testing.assert_allclose(rotations, bodies.rotations[1, k], atol=1e-3)
    np.testing.assert_allclose(shift, bodies.shifts[1, k], atol=1e-3)


def test_a_build_is_sound_and_its_truth_is_skinned_at_high_resolution(tmp_path):
    document = build(
        SOURCE, tmp_path / "new", options=BuildOptions(subjects=(12,), target_vertices=8000), workers=1
    )
    assert document["name"] == "defaust-new_bodies" and verify(tmp_path / "new") == []
    low, high = (load_task(tmp_path / "new", subject=12, pose=6, resolution=name) for name in ("low", "high"))
    assert low.name == "defaust-new_bodies/subject_12/pose_6"
    pose = SOURCE.poses(12)[5]
    assert pose.name == "lunge"
    np.testing.assert_allclose(low.truth, SOURCE.posed(12, pose).V, atol=1e-12)
    assert high.meta["posed_by"] == "skinning" and high.mesh.n != low.mesh.n
