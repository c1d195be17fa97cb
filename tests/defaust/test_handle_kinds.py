"""Points, landmarks and regions as handles for the same pose."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from defaust.edits import Unedited
from defaust.tasks import load_task
from defaust.tasks.handle_kinds import FEW, REACH, of_kind
from sshade import Handles, InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from tests.shapes import end_handles, icosphere

TURN = Rotation.from_euler("xyz", [20, -70, 35], degrees=True).as_matrix()


@pytest.fixture(scope="module")
def ball():
    rng = np.random.default_rng(1)
    sphere = icosphere(5)
    return Mesh(sphere.V * [1.0, 1.3, 0.8] + 1e-3 * rng.standard_normal((sphere.n, 3)), sphere.F)


@pytest.fixture(scope="module")
def handles(ball):
    """A few about the lowest vertex, which stay, and about the highest, which turn."""
    ends = end_handles(ball.V, axis=1, share=0.005, turn=TURN, shift=[1.0, 2.0, 3.0])
    some = np.random.default_rng(3).permutation(len(ends))[::3]
    return Handles(ends.index[some], ends.target[some], dynamic=ends.dynamic[some], group=ends.group[some])


def distances(mesh, vertex):
    """Distances along the edges, by scipy."""
    return dijkstra(vertex_graph(mesh).matrix, directed=False, indices=vertex)


def test_points_are_the_middles_of_the_groups_and_regions_are_rigid_discs_about_them(ball, handles):
    points, regions = (of_kind(ball, handles, kind) for kind in ("points", "regions"))
    assert points.group.tolist() == [0, 1] and points.dynamic.tolist() == [False, True]
    for middle, target, group in zip(points.index, points.target, points.group, strict=True):
        own = handles.group == group
        off = np.linalg.norm(ball.V[handles.index[own]] - ball.V[handles.index[own]].mean(axis=0), axis=1)
        assert middle == handles.index[own][off.argmin()]
        np.testing.assert_array_equal(target, handles.target[own][off.argmin()])
        inside = np.flatnonzero(distances(ball, middle) <= REACH * ball.diagonal)
        assert sorted(regions.index[regions.group == group]) == inside.tolist() and len(inside) > 30
    np.testing.assert_array_equal(regions.dynamic, regions.group == 1)
    rest = ball.V[regions.index]
    expected = np.where(regions.dynamic[:, None], rest @ TURN.T + [1.0, 2.0, 3.0], rest)
    np.testing.assert_allclose(regions.target, expected, atol=1e-12)


def test_landmarks_of_regions_are_few_and_spread_from_the_tips(ball, handles):
    few = of_kind(ball, handles, "landmarks", are_regions=True)
    assert np.bincount(few.group).tolist() == [FEW, FEW]
    places = {int(vertex): k for k, vertex in enumerate(handles.index)}
    where = [places[int(vertex)] for vertex in few.index]
    np.testing.assert_array_equal(few.target, handles.target[where])
    np.testing.assert_array_equal(few.dynamic, handles.dynamic[where])
    tips = of_kind(ball, handles, "points", are_regions=True).index
    out = np.linalg.norm(ball.V - ball.V.mean(axis=0), axis=1)
    for group, tip in zip((0, 1), tips, strict=True):
        own, chosen = handles.index[handles.group == group], few.index[few.group == group]
        assert tip in chosen and out[tip] == out[own].max()
        # Farthest point sampling: no two samples are nearer than any other vertex is to its nearest sample.
        apart = np.array([distances(ball, vertex) for vertex in chosen])
        pairs = apart[:, chosen] + np.where(np.eye(FEW), np.inf, 0)
        assert pairs.min() >= apart[:, np.setdiff1d(own, chosen)].min(axis=0).max()


def test_of_two_regions_that_meet_each_vertex_is_of_the_nearer(ball):
    top = int(ball.V[:, 1].argmax())
    beside = int(np.flatnonzero(distances(ball, top) < 0.6 * REACH * ball.diagonal)[-1])
    target = ball.V[[top, beside]] + [[1.0, 0, 0], [2.0, 0, 0]]
    pair = Handles(np.array([top, beside]), target, group=np.array([0, 1]))
    regions = of_kind(ball, pair, "regions")
    nearer = np.argmin([distances(ball, top), distances(ball, beside)], axis=0)[regions.index]
    np.testing.assert_array_equal(regions.group, nearer)
    np.testing.assert_allclose((regions.target - ball.V[regions.index])[:, 0], 1.0 + nearer, atol=1e-12)


def test_a_task_takes_any_kind_and_is_named_by_it(finished):
    stored = load_task(finished, subject=1, pose=2)
    for kind in ("points", "landmarks", "regions"):
        task = load_task(finished, subject=1, pose=2, handles=kind)
        assert task.name == f"{stored.name}/{kind}" and task.meta["handles"] == kind
        # The pose turns the whole body, so all handles agree with the ground truth.
        truth = stored.truth[task.handles.index]
        np.testing.assert_allclose(task.handles.target, truth, atol=2e-2 * stored.mesh.diagonal)
    with pytest.raises(InputError, match="a pose transfer has no handles; leave handles=points out"):
        load_task(finished, subject=1, pose=2, handles="points", edit=Unedited())
