"""Many poses of one mesh: bound once, each pose from the pose before, without flicker."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, deform, deform_sequence
from sshade.method.bound import Bound
from sshade.method.sequence import NEAR_POSE
from sshade.problem.options import resolve
from tests.shapes import bumpy, end_handles, tube


def bar() -> DeformationTask:
    mesh = tube(24, 60, length=6.0)
    return DeformationTask("bar", mesh, end_handles(mesh.V, share=0.1))


def bends(task: DeformationTask, angles: np.ndarray) -> list[np.ndarray]:
    """Return targets for each angle: the upper end turns about an axis across the bar, the lower stays."""
    rest = task.mesh.V[task.handles.index]
    turns = [Rotation.from_rotvec([angle, 0, 0]) for angle in angles]
    return [np.where(task.handles.dynamic[:, None], turn.apply(rest), rest) for turn in turns]


PLAIN = ("paper", {"accelerate": False})


@pytest.mark.parametrize(("method", "more"), [("fast", {}), ("paper", {}), ("fine", {}), PLAIN])
def test_poses_far_from_the_pose_before_have_the_bits_of_single_runs(method, more):
    task = bar()
    poses = bends(task, np.array([0.8, -0.4, 0.6]))
    options = {"method": method, "vertices": 150, **more}
    for pose, result in zip(poses, deform_sequence(task, poses, **options), strict=True):
        single = deform(replace(task, handles=task.handles.at(pose)), **options)
        assert not result.facts.followed
        np.testing.assert_array_equal(result.vertices, single.vertices)


def test_near_poses_follow_the_pose_before_and_others_do_not():
    task = bar()
    up = task.handles.dynamic[:, None] * np.array([0.0, 0, 1]) * NEAR_POSE * task.mesh.diagonal
    poses = bends(task, np.linspace(0.3, 0.4, 3))
    poses += [poses[-1] + 1.01 * up, poses[-1] + 0.02 * up]
    results = list(deform_sequence(task, poses, vertices=300))
    assert [result.facts.followed for result in results] == [False, True, True, False, True]
    single = deform(replace(task, handles=task.handles.at(poses[-1])), vertices=300)
    assert np.abs(results[-1].vertices - single.vertices).max() < 2e-3 * task.mesh.diagonal
    for pose, result in zip(poses, results, strict=True):
        np.testing.assert_allclose(result.vertices[task.handles.index], pose, atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"volume_goal": 1.3}])
def test_a_sequence_goes_on_with_the_same_bits_although_volumes_were_corrected(options):
    mesh, options = bumpy(4), {**options, "vertices": 300}
    ends = end_handles(mesh.V, count=20 if "volume_goal" in options else mesh.n // 4)
    rest, task = mesh.V[ends.index], DeformationTask("grown", mesh, ends)
    poses = [ends.at(np.where(ends.dynamic[:, None], s * rest, rest)) for s in (1.1, 1.15)]
    first, last = deform_sequence(task, poses, **options)
    assert last.facts.followed
    again = Bound.of_task(task, resolve("fast", options), keep=True).solve(poses[1], guess=first.vertices)
    np.testing.assert_array_equal(again.vertices, last.vertices)
