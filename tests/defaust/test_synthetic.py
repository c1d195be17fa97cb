"""The asset of the synthetic bodies, its source, and the skinning."""

import shutil
from importlib import resources

import numpy as np
import pytest

from defaust.build.upsample import self_intersecting
from defaust.sources import source as sources
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.synthetic import SyntheticBodies, load_bodies
from sshade import InputError
from tests.defaust.toy import flip_a_byte

SUBJECTS = range(10)


def test_asset_with_a_flipped_byte_is_refused(tmp_path, monkeypatch):
    shutil.copytree(resources.files("defaust") / "data", tmp_path / "data")
    flip_a_byte(tmp_path / "data/bodies.npz", 1000)
    monkeypatch.setattr(sources.resources, "files", lambda package: tmp_path)
    load_bodies.cache_clear()
    with pytest.raises(InputError, match="damaged"):
        load_bodies()
    load_bodies.cache_clear()


@pytest.mark.parametrize("subject", SUBJECTS)
def test_bodies_are_closed_and_in_correspondence(subject):
    source = SyntheticBodies()
    rest, *posed = [source.rest(subject), *(source.posed(subject, pose) for pose in source.poses(subject))]
    assert rest.V[:, 1].min() == pytest.approx(0.0, abs=2e-4)
    assert 1.4 < np.ptp(rest.V[:, 1]) < 1.9
    touching = [bool(self_intersecting(mesh).any()) for mesh in (rest, *posed)]
    assert not any(touching[:5]) and sum(touching[5:]) >= 5
    for mesh in (rest, *posed):
        assert (mesh.n, mesh.m) == (6890, 13776)
        assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented
        assert mesh.topology == (2, 1, 0)
        assert 0.04 < mesh.volume < 0.085
        assert abs(mesh.volume / rest.volume - 1) < 0.08
        assert mesh.face_areas.min() > 1e-8
        np.testing.assert_array_equal(mesh.F, SyntheticBodies().rest(0).F)


def test_bone_motions_follow_the_chain():
    joints = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    rotations = np.array([[0, 0, np.pi / 2], [0, 0, np.pi / 2]])
    motions = bone_motions(joints, np.array([-1, 0]), rotations=rotations)
    # The elbow moves to (0, 1, 0); the point one unit beyond it turns by half a turn.
    np.testing.assert_allclose(apply_motions(motions[[1]], np.array([[2.0, 0, 0]])), [[-1, 1, 0]], atol=1e-15)


def test_skinning_does_not_collapse_under_twist():
    # The mean of no rotation and a half turn is a quarter turn; linear blending would give radius 0.
    motions = bone_motions(
        np.zeros((2, 3)), np.array([-1, 0]), rotations=np.array([[0, 0, 0], [np.pi - 1e-9, 0, 0]])
    )
    V = np.array([[0.5, 1.0, 0.0]])
    half = np.full((1, 2), 0.5)
    out = apply_motions(blend_motions(motions, bone=np.array([[0, 1]]), weight=half), V)
    np.testing.assert_allclose(out, [[0.5, 0.0, 1.0]], atol=1e-8)
