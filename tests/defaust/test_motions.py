"""Sequences of generated bodies and animals, and poses that drive others."""

import numpy as np
import pytest

from defaust.sources.synthetic import load_bodies
from defaust.tasks.motions import DIRECTIONS, body_motion, drives
from sshade import InputError, Mesh


def test_a_motion_goes_from_rest_into_its_pose_slowly_at_both_ends():
    motion = body_motion(pose="arms_up", count=9)
    bodies = load_bodies()
    k = bodies.pose_names.index("arms_up")
    np.testing.assert_allclose(motion.truth[0], bodies.rest[0], atol=1e-12)
    last = bodies.pose(0, rotations=bodies.rotations[0, k], shift=bodies.shifts[0, k])
    np.testing.assert_allclose(motion.truth[-1], last, atol=1e-12)
    steps = np.linalg.norm(np.diff(motion.truth, axis=0), axis=2).mean(axis=1)
    assert (np.diff(steps[:4]) > 0).all() and (np.diff(steps[4:]) < 0).all()
    np.testing.assert_array_equal(motion.targets[3], motion.truth[3][motion.task.handles.index])
    with pytest.raises(InputError, match="pose"):
        body_motion(pose="fly", count=3)


def test_drives_have_marks_on_both_meshes_and_truths_that_keep_lengths():
    body, animal = drives(((0, 4), ("cat", "lizard")))
    for drive in (body, animal):
        assert len(drive.poses) == len(drive.truth) == len(drive.pose_names) == 4
        assert drive.marks[:, 0].max() < drive.source.n and drive.marks[:, 1].max() < drive.target.n
        for side in (0, 1):
            assert len(np.unique(drive.marks[:, side])) == len(drive.marks)
        for truth in drive.truth:
            assert Mesh(truth, drive.target.F).area == pytest.approx(drive.target.area, rel=0.1)
    assert len(animal.marks) > 15 * len(DIRECTIONS) and len(body.marks) == 60
    assert animal.source.n != animal.target.n
