"""Poses of one mesh drive another mesh with other vertices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.sources.synthetic import load_bodies
from defaust.tasks.motions import spread
from sshade import InputError, Mesh, deform, retarget
from sshade.pipeline.proxies import bind
from sshade.pipeline.retarget import Retargeting
from tests.shapes import beside, bumpy, shifted, tube


def same(count: int, mesh: Mesh) -> np.ndarray:
    return np.repeat(spread(mesh.V, count)[:, None], 2, axis=1)


def test_a_mesh_that_drives_itself_rebuilds_its_poses():
    mesh = tube(24, 60, length=6.0)
    ends = np.concatenate([np.arange(24), np.arange(mesh.n - 24, mesh.n)])
    goal = mesh.V[ends].copy()
    goal[24:] = Rotation.from_rotvec([0.6, 0, 0]).apply(goal[24:])
    posed = deform(mesh, ends, goal, vertices=200).V
    driver = Retargeting(mesh, mesh, same(30, mesh))
    np.testing.assert_allclose(driver.fitted.V, mesh.V, atol=1e-9 * mesh.diagonal)
    places = driver(posed)
    np.testing.assert_allclose(places, posed[driver.marks[:, 0]], atol=1e-6 * mesh.diagonal)


@pytest.mark.parametrize("size", [0.5, 1.0, 3.0])
def test_a_rigid_motion_of_the_source_moves_the_target_rigidly_at_its_own_size(size):
    source = bumpy(3)
    target = Mesh(size * source.V * [1.0, 1.0, 1.2] + [4.0, 0, 0], source.F)
    R, t = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), np.array([1.0, 2.0, -3.0])
    posed = source.V @ R.T + t
    (moved,) = (result.vertices for result in retarget(source, [posed], target, marks=same(20, source)))
    apart = moved - moved.mean(axis=0)
    np.testing.assert_allclose(apart, (target.V - target.V.mean(axis=0)) @ R.T, atol=1e-4 * target.diagonal)


def test_marks_on_a_stretched_copy_follow_its_proportions():
    """A bar of twice the length bends by the same angle, so its end moves farther than the source's end."""
    source = tube(24, 60, length=6.0)
    target = Mesh(source.V * [1.0, 1.0, 2.0], source.F)

    def bent(V, length):
        """Bend the axis z of a bar to an arc of 90 degrees, without a change of length."""
        angle = np.pi / 2 * V[:, 2] / length
        r = length / (np.pi / 2)
        y = r - (r - V[:, 1]) * np.cos(angle)
        return np.stack([V[:, 0], y, (r - V[:, 1]) * np.sin(angle)], axis=1)

    source_length, target_length = np.ptp(source.V[:, 2]), np.ptp(target.V[:, 2])
    driver = Retargeting(source, target, same(60, source))
    places = driver(bent(source.V, source_length))
    truth = bent(target.V, target_length)[driver.marks[:, 1]]
    apart = (places - places.mean(axis=0)) - (truth - truth.mean(axis=0))
    assert np.linalg.norm(apart, axis=1).max() < 0.02 * target.diagonal
    copied = target.V[driver.marks[:, 1]] + (bent(source.V, source_length) - source.V)[driver.marks[:, 0]]
    copied = (copied - copied.mean(axis=0)) - (truth - truth.mean(axis=0))
    assert np.linalg.norm(copied, axis=1).max() > 5 * np.linalg.norm(apart, axis=1).max()


def test_a_body_takes_the_poses_of_another_body():
    """The bodies share a skeleton, so the ground truth is known. The target has a separate coarse mesh."""
    bodies = load_bodies()
    source = Mesh(bodies.rest[0], bodies.faces)
    whole = Mesh(bodies.rest[4], bodies.faces)
    marks = spread(source.V, 60)
    coarse = bind(whole, 2500, first=marks, seed=1)
    target, samples = coarse.proxy, coarse.sampling.samples
    pairs = np.stack([marks, np.argsort(samples)[np.searchsorted(np.sort(samples), marks)]], axis=1)
    np.testing.assert_array_equal(target.V[pairs[:, 1]], whole.V[marks])

    def posed(subject: int, pose: int) -> np.ndarray:
        return bodies.pose(subject, rotations=bodies.rotations[0, pose], shift=bodies.shifts[0, pose])

    poses = [posed(0, pose) for pose in (0, 1, 4)]
    for pose, result in zip((0, 1, 4), retarget(source, poses, target, marks=pairs), strict=True):
        truth = posed(4, pose)[samples]
        V = result.vertices + (truth - result.vertices).mean(axis=0)
        error = np.linalg.norm(V - truth, axis=1) / target.diagonal
        still = np.linalg.norm(target.V - truth + (truth - target.V).mean(axis=0), axis=1) / target.diagonal
        assert error.mean() < 0.007 and error.mean() < 0.2 * still.mean()


def test_other_components_of_the_source_and_of_the_target_come_along():
    ball = bumpy(2)
    pair = beside(ball, shifted(ball, [6.0, 0, 0]))
    marks = same(20, ball)
    posed = np.concatenate([ball.V + [0, 1, 0], ball.V + [40.0, 0, 0]])
    (moved,) = (result.vertices for result in retarget(pair, [posed], pair, marks=marks))
    np.testing.assert_allclose(moved, pair.V + [0, 1, 0], atol=1e-6)
    both = np.concatenate([marks, marks[:1] + ball.n])
    with pytest.raises(InputError, match="several components"):
        Retargeting(pair, pair, both)


def test_faces_of_the_source_without_area_change_nothing():
    mesh = bumpy(2)
    V = np.concatenate([mesh.V, mesh.V[mesh.F[0, :1]]])
    F = np.concatenate([mesh.F, [[mesh.F[0, 0], len(mesh.V), mesh.F[0, 1]]]])
    R = Rotation.from_rotvec([0.2, 0.5, 0]).as_matrix()
    places = [Retargeting(source, mesh, same(15, mesh))(source.V @ R.T) for source in (mesh, Mesh(V, F))]
    np.testing.assert_allclose(places[1], places[0], atol=2e-3 * mesh.diagonal)


@pytest.mark.parametrize(
    ("marks", "words"),
    [
        ([[0, 0], [1, 1], [2, 2]], "3 marks are given, and at least 4 are needed"),
        ([[0, 0], [1, 1], [2, 2], [9999, 3]], "vertex 9999 of the source, which has"),
        ([[0, 0], [1, 1], [2, 2], [3, -1]], "vertex -1 of the target, which has"),
        ([[0, 0], [1, 1], [2, 2], [2, 3]], "two marks are at vertex 2 of the source"),
        ([[0.0, 0], [1, 1], [2, 2], [3, 3]], "marks are pairs of vertex ids"),
        ([0, 1, 2, 3], "marks are pairs of vertex ids"),
    ],
)
def test_bad_marks_are_refused(small_body, marks, words):
    with pytest.raises(InputError, match=words):
        Retargeting(small_body, small_body, np.array(marks))


def test_a_pose_of_another_mesh_is_refused(small_body):
    driver = Retargeting(small_body, small_body, same(10, small_body))
    with pytest.raises(InputError, match="pose of the source"):
        driver(small_body.V[1:])
    with pytest.raises(InputError, match="NaN or infinite"):
        driver(np.full_like(small_body.V, np.nan))
