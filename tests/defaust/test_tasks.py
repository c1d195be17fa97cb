"""Tasks as methods see them."""

import json

import numpy as np

from defaust.tasks import TaskId, list_tasks, load_task
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.toy import relist


def test_tasks_are_listed_by_subjects_and_poses(finished):
    assert list_tasks(finished) == [TaskId(s, p) for s in range(3) for p in (1, 2)]
    assert list_tasks(finished, subjects=[2, 0], poses=[1]) == [(0, 1), (2, 1)]


def test_a_task_at_low_resolution_is_exact(finished):
    task = load_task(finished, subject=1, pose=2, resolution="low")
    posed = read_mesh(finished / "subject_01/pose_2_low.ply")
    np.testing.assert_array_equal(task.truth, posed.V)
    np.testing.assert_array_equal(task.handles.target, posed.V[task.handles.index])
    assert np.bincount(task.handles.group).tolist() == [6, 6, 6]
    assert task.handles.dynamic.all()
    assert task.meta["snap_max"] == 0 and task.meta["merged"] == 0


def test_static_handles_stay_at_their_vertices_and_raw_handles_keep_their_targets(finished):
    task = load_task(finished, subject=0, pose=1)
    static = task.handles.index[~task.handles.dynamic]
    assert len(static) == task.meta["n_static"] > 0
    np.testing.assert_array_equal(task.handles.target[~task.handles.dynamic], task.mesh.V[static])
    # Group ids are landmark ids: the top (0) moves, the bottom (1) stays.
    assert set(task.handles.group[task.handles.dynamic]) == {0}
    assert set(task.handles.group[~task.handles.dynamic]) == {1}
    raw = load_task(finished, subject=0, pose=1, raw=True)
    stored = json.loads((finished / "subject_00/pose_1.json").read_text())["handles"]
    targets = {tuple(t) for h in stored[:2] for t in h["target"]}
    assert raw.meta["merged"] + len(raw.handles) == len(targets) == 12
    # Handles that are not merged keep their stored targets.
    assert sum(tuple(t) in targets for t in raw.handles.target.tolist()) >= 12 - 2 * raw.meta["merged"] > 0


def test_a_task_without_ground_truth_has_a_reason(dataset):
    low = read_mesh(dataset / "subject_00/rest_low.ply")
    write_mesh(dataset / "subject_00/rest_low.ply", 1.02 * low.V, low.F)
    relist(dataset, "subject_00/rest_low.ply")
    task = load_task(dataset, subject=0, pose=1)
    assert task.truth is None and "was not made from the subdivided registered mesh" in task.meta["no_truth"]
    assert "posed_by" not in task.meta and len(task.handles) > 0
