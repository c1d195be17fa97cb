"""Pose transfers of a dataset: edited meshes, poses, and ground truth."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.edits import Inflate, Unedited
from defaust.tasks import load_task
from sshade import TransferTask
from sshade.files.meshes import read_mesh

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
