"""Tasks as methods see them."""

import json

import numpy as np
import pytest

from defaust.folder.layout import sha256
from defaust.tasks import TaskId, list_tasks, load_task
from sshade import InputError
from sshade.io.meshes import read_mesh
from tests.defaust.toy import change


def test_list(finished):
    assert list_tasks(finished) == [TaskId(s, p) for s in range(3) for p in (1, 2)]
    assert list_tasks(finished, subjects=[2, 0], poses=[1]) == [(0, 1), (2, 1)]
    with pytest.raises(InputError, match=r"no pose 0; it has \[1, 2\]"):
        list_tasks(finished, poses=[0])


def test_low_resolution_is_exact(finished):
    task = load_task(finished, subject=1, pose=2, resolution="low")
    posed = read_mesh(finished / "subject_01/pose_2_low.ply")
    np.testing.assert_array_equal(task.truth, posed.V)
    np.testing.assert_array_equal(task.handles.target, posed.V[task.handles.index])
    assert np.bincount(task.handles.group).tolist() == [6, 6, 6]
    assert task.handles.dynamic.all()
    assert task.meta["snap_max"] == 0 and task.meta["merged"] == 0


def test_static_handles_stay_where_their_vertices_are(finished):
    task = load_task(finished, subject=0, pose=1)
    assert task.truth is None
    static = task.handles.index[~task.handles.dynamic]
    assert len(static) == task.meta["n_static"] > 0
    np.testing.assert_array_equal(task.handles.target[~task.handles.dynamic], task.mesh.V[static])
    # Group ids are positions in the dataset's list of landmarks: top moves, bottom stays.
    assert set(task.handles.group[task.handles.dynamic]) == {0}
    assert set(task.handles.group[~task.handles.dynamic]) == {1}
    raw = load_task(finished, subject=0, pose=1, raw=True)
    stored = json.loads((finished / "subject_00/pose_1.json").read_text())["handles"]
    single = [t for h in stored[:2] for t in h["target"]]
    assert raw.meta["merged"] + len(raw.handles) == len(single) == 12
    assert any(np.array_equal(raw.handles.target[0], t) for t in single) or raw.meta["merged"] > 0
    assert not np.array_equal(raw.handles.target, task.handles.target)


def test_meta(finished):
    task = load_task(finished, subject=2, pose=1)
    sums = [sha256(finished / "subject_02" / name)[:16] for name in ("rest.ply", "pose_1.json")]
    assert task.name == "defaust-balls/subject_02/pose_1"
    assert task.meta["checksum"] == "+".join(sums) and task.meta["source_pose"] == "lean"
    assert (task.meta["source"], task.meta["subject"], task.meta["pose"]) == ("balls", 2, 1)
    assert task.meta["n_static"] + task.meta["n_dynamic"] == len(task.handles)


def test_wrong_requests(finished):
    assert load_task(finished, subject=0, pose=1, source="balls").name
    with pytest.raises(InputError, match="was built with source=balls, not source=faust"):
        load_task(finished, subject=0, pose=1, source="faust")


def test_damaged_files(dataset):
    (dataset / "subject_01/pose_1_low.ply").unlink()
    with pytest.raises(InputError, match="pose_1_low.ply is missing"):
        load_task(dataset, subject=1, pose=1, resolution="low")
    change(dataset, lambda d: d["files"].pop("subject_02/rest.ply"))
    with pytest.raises(InputError, match="lists no subject_02/rest.ply"):
        load_task(dataset, subject=2, pose=1)
