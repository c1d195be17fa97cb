"""Points, landmarks and regions as handles for the same pose."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from defaust.edits import Unedited
from defaust.tasks import load_task
from defaust.tasks.handle_kinds import FEW, REACH, of_kind
from sshade import Handles, InputError, Mesh
from sshade.mesh.adjacency import edge_graph
from tests.shapes import end_handles, icosphere

KINDS = ("points", "landmarks", "regions")
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
    return dijkstra(edge_graph(mesh).matrix, directed=False, indices=vertex)


def test_a_point_of_each_group_is_its_middle_and_goes_where_it_went(ball, handles):
    points = of_kind(ball, handles, "points")
    assert points.group.tolist() == [0, 1] and points.dynamic.tolist() == [False, True]
    for index, target, group in zip(points.index, points.target, points.group, strict=True):
        own = handles.group == group
        off = np.linalg.norm(ball.V[handles.index[own]] - ball.V[handles.index[own]].mean(axis=0), axis=1)
        assert index == handles.index[own][off.argmin()]
        np.testing.assert_array_equal(target, handles.target[own][off.argmin()])


def test_regions_are_rigid_discs_about_the_middles(ball, handles):
    points, regions = (of_kind(ball, handles, kind) for kind in ("points", "regions"))
    for middle, group in zip(points.index, points.group, strict=True):
        own = regions.group == group
        inside = np.flatnonzero(distances(ball, middle) <= REACH * ball.diagonal)
        assert sorted(regions.index[own]) == inside.tolist() and own.sum() > 30
        assert len(set(regions.dynamic[own])) == 1
    fixed = ~regions.dynamic
    np.testing.assert_array_equal(regions.target[fixed], ball.V[regions.index[fixed]])
    moved = regions.index[regions.dynamic]
    expected = ball.V[moved] @ TURN.T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(regions.target[regions.dynamic], expected, atol=1e-12)


def test_landmarks_of_regions_are_few_and_spread(ball, handles):
    assert of_kind(ball, handles, "landmarks") is handles
    few = of_kind(ball, handles, "landmarks", are_regions=True)
    assert np.bincount(few.group).tolist() == [FEW, FEW]
    places = {int(vertex): k for k, vertex in enumerate(handles.index)}
    where = [places[int(vertex)] for vertex in few.index]
    np.testing.assert_array_equal(few.target, handles.target[where])
    np.testing.assert_array_equal(few.dynamic, handles.dynamic[where])
    tips = of_kind(ball, handles, "points", are_regions=True).index
    assert np.isin(tips, few.index).all()
    out = np.linalg.norm(ball.V - ball.V.mean(axis=0), axis=1)
    for group, tip in zip((0, 1), tips, strict=True):
        assert out[tip] == out[handles.index[handles.group == group]].max()
    # Farthest point sampling: no two samples are nearer than any other vertex is to its nearest sample.
    for group in (0, 1):
        own, chosen = handles.index[handles.group == group], few.index[few.group == group]
        apart = np.array([distances(ball, vertex) for vertex in chosen])
        rest = np.setdiff1d(own, chosen)
        pairs = apart[:, chosen] + np.where(np.eye(FEW), np.inf, 0)
        assert pairs.min() >= apart[:, rest].min(axis=0).max()


def test_of_two_regions_that_meet_each_vertex_is_of_the_nearer(ball):
    top = int(ball.V[:, 1].argmax())
    beside = int(np.flatnonzero(distances(ball, top) < 0.6 * REACH * ball.diagonal)[-1])
    target = ball.V[[top, beside]] + [[1.0, 0, 0], [2.0, 0, 0]]
    pair = Handles(np.array([top, beside]), target, group=np.array([0, 1]))
    regions = of_kind(ball, pair, "regions")
    nearer = np.argmin([distances(ball, top), distances(ball, beside)], axis=0)[regions.index]
    np.testing.assert_array_equal(regions.group, nearer)
    assert 0 < nearer.sum() < len(nearer)
    np.testing.assert_allclose((regions.target - ball.V[regions.index])[:, 0], 1.0 + nearer, atol=1e-12)


def test_stored_handles_are_these(ball, handles):
    assert of_kind(ball, handles, "stored") is handles
    assert of_kind(ball, handles, "regions", are_regions=True) is handles
    with pytest.raises(InputError, match="handles=groups is unknown; use one of stored, points, landmarks"):
        of_kind(ball, handles, "groups")


def test_tasks_of_all_kinds(finished):
    stored = load_task(finished, subject=1, pose=2)
    tasks = {kind: load_task(finished, subject=1, pose=2, handles=kind) for kind in KINDS}
    for kind, task in tasks.items():
        assert task.name == f"{stored.name}/{kind}" and task.meta["handles"] == kind
        assert task.meta["n_static"] + task.meta["n_dynamic"] == len(task.handles)
    assert len(tasks["points"].handles) == 3
    np.testing.assert_array_equal(tasks["landmarks"].handles.target, stored.handles.target)
    with pytest.raises(InputError, match="a pose transfer has no handles; leave handles=points out"):
        load_task(finished, subject=1, pose=2, handles="points", edit=Unedited())
    # The pose turns the whole body, so every region agrees with the ground truth.
    regions = tasks["regions"].handles
    np.testing.assert_allclose(regions.target, stored.truth[regions.index], atol=2e-2 * stored.mesh.diagonal)
