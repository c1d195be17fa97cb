"""Tasks as methods see them, with handles of every kind, and pose transfers."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from defaust.edits import Inflate, Unedited
from defaust.tasks import load_task
from defaust.tasks.handle_kinds import FEW, REACH, of_kind
from sshade import Handles, InputError, Mesh, TransferTask
from sshade.files.meshes import read_mesh, write_mesh
from sshade.mesh.adjacency import vertex_graph
from tests.defaust.toy import flip_a_byte, relist
from tests.shapes import end_handles, icosphere


def test_a_task_without_ground_truth_has_a_reason(dataset):
    high = read_mesh(dataset / "subject_00/rest.ply")
    off = 1e-4 * (np.arange(high.n) == 9)[:, None]  # a single vertex
    write_mesh(dataset / "subject_00/rest.ply", high.V + off, high.F)
    relist(dataset, "subject_00/rest.ply")
    task = load_task(dataset, subject=0, pose=1)
    assert task.truth is None and "was not made from the subdivided registered mesh" in task.meta["no_truth"]
    assert "posed_by" not in task.meta and len(task.handles) > 0


@pytest.mark.parametrize("name", ["rest_low.ply", "pose_1_low.ply", "pose_1.json"])
def test_no_task_is_read_from_a_damaged_file(dataset, name):
    flip_a_byte(dataset / "subject_00" / name)
    with pytest.raises(InputError, match=f"{name} is not the file that the dataset lists"):
        load_task(dataset, subject=0, pose=1)


BELLY = Inflate(at=(0.5, 0.62, 0.5), radius=0.12, amount=0.05)


def test_isometric_at_full_size_by_skinning(body):
    task = load_task(body, subject=4, pose=1, edit=Unedited())
    assert isinstance(task, TransferTask) and task.name == "defaust-synthetic/subject_04/pose_1"
    assert task.mesh is task.rest and task.truth is task.posed
    np.testing.assert_array_equal(task.rest.V, read_mesh(body / "subject_04/rest.ply").V)
    posed = read_mesh(body / "subject_04/pose_1_low.ply")
    rest = read_mesh(body / "subject_04/rest_low.ply")
    # On average each vertex moves like its nearest registered vertex.
    nearest = cKDTree(rest.V).query(task.rest.V)[1]
    moved = (task.posed - task.rest.V) - (posed.V - rest.V)[nearest]
    assert np.linalg.norm(moved, axis=1).mean() < 0.005
    facts = [task.meta[name] for name in ("class", "edit", "posed_by", "source_pose", "resolution")]
    assert facts == ["subject_04", "none", "skinning", "sitting", "high"]
    low = load_task(body, subject=4, pose=1, resolution="low", edit=Unedited())
    assert np.array_equal(low.truth, posed.V) and low.meta["posed_by"] == "registration"


@pytest.mark.parametrize("resolution", ["high", "low"])
def test_an_edited_body_has_a_truth(body, resolution):
    plain = load_task(body, subject=4, pose=1, resolution=resolution, edit=Unedited())
    task = load_task(body, subject=4, pose=1, resolution=resolution, edit=BELLY)
    assert task.name == plain.name + "/inflate" and task.meta["edit"] == "inflate"
    np.testing.assert_array_equal(task.rest.V, plain.rest.V)
    np.testing.assert_array_equal(task.posed, plain.posed)
    np.testing.assert_array_equal(task.mesh.V, BELLY(plain.rest))
    edited = (task.mesh.V != task.rest.V).any(axis=1)
    assert 0.02 < edited.mean() < 0.5
    np.testing.assert_allclose(task.truth[~edited], task.posed[~edited], atol=1e-12)
    # A displacement turns with the body and keeps its length.
    before, after = (np.linalg.norm(d, axis=1) for d in (task.mesh.V - task.rest.V, task.truth - task.posed))
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_a_source_without_a_skin_is_subdivided_and_leaves_edits_without_truth(finished):
    task = load_task(finished, subject=1, pose=1, edit=Unedited())
    assert task.meta["posed_by"] == "subdivision" and task.truth is task.posed
    # This pose is a shear above the equator.
    expected = task.rest.V + [1.0, 0, 0] * np.maximum(0, task.rest.V[:, 1:2])
    gap = np.abs(task.posed - expected)
    assert gap.max() < 0.04 and gap.mean() < 1e-3  # in the triangles that the equator crosses
    edited = load_task(finished, subject=1, pose=1, edit=Inflate((0.5, 1, 0.5), radius=0.2, amount=0.1))
    assert edited.truth is None and edited.posed.shape == edited.mesh.V.shape


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
