"""The asset of the synthetic bodies, its source, and the skinning."""

import hashlib
import shutil
from importlib import resources

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.build.upsample import self_intersecting
from defaust.sources import synthetic
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import SourcePose
from defaust.sources.synthetic import SyntheticBodies, load_bodies, read_asset
from sshade import InputError
from tests.defaust.registrations import contents
from tests.defaust.toy import flip_a_byte
from tests.full import few

SUBJECTS = range(10)
APART = ("arms_up", "leg_lift", "squat", "bend_twist")
TOUCHING = ("hands_on_hips", "forearms_raised", "hands_together", "one_leg", "sitting", "arms_crossed")


@pytest.fixture(scope="module")
def meshes():
    source = SyntheticBodies()
    return {s: [source.rest(s), *(source.posed(s, pose) for pose in source.poses(s))] for s in SUBJECTS}


def test_asset_with_a_flipped_byte_is_refused(tmp_path, monkeypatch):
    shutil.copytree(resources.files("defaust") / "data", tmp_path / "data")
    flip_a_byte(tmp_path / "data/bodies.npz", 1000)
    monkeypatch.setattr(synthetic.resources, "files", lambda package: tmp_path)
    load_bodies.cache_clear()
    with pytest.raises(InputError, match="damaged"):
        load_bodies()
    load_bodies.cache_clear()


def test_bodies_and_the_first_four_poses_stay_as_they_were():
    """Tables of datasets that hold four poses can be made again; the hash was taken before there were ten."""
    arrays = read_asset()
    arrays |= {name: arrays[name][:, :4] for name in ("rotations", "shifts")}
    arrays["pose_names"] = arrays["pose_names"][:4].astype("<U10")
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + arrays[name].tobytes())
    assert digest.hexdigest() == "25b6dc2c0a9bc07a388c37dd2cc68b554d5b4c55d3be219eae22a20213dc6e01"


def test_poses_do_not_depend_on_which_others_are_built(tmp_path):
    for name, poses in (("four", APART), ("ten", None)):
        options = BuildOptions(subjects=(7,), target_vertices=None)
        build(SyntheticBodies(poses_used=poses), tmp_path / name, options=options, workers=1)
    four, ten = (contents(tmp_path / name / "subject_07") for name in ("four", "ten"))
    assert len(four) == 2 + 2 * 4 and len(ten) == 2 + 2 * 10
    assert {name: ten[name] for name in four} == four


@pytest.mark.parametrize("subject", SUBJECTS)
def test_bodies_are_closed_and_in_correspondence(meshes, subject):
    rest = meshes[subject][0]
    assert rest.V[:, 1].min() == pytest.approx(0.0, abs=2e-4)
    assert 1.4 < np.ptp(rest.V[:, 1]) < 1.9
    for mesh in meshes[subject]:
        assert (mesh.n, mesh.m) == (6890, 13776)
        assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented
        assert mesh.topology == (2, 1, 0)
        assert 0.04 < mesh.volume < 0.085
        assert abs(mesh.volume / rest.volume - 1) < 0.08
        assert mesh.face_areas.min() > 1e-8
        np.testing.assert_array_equal(mesh.F, meshes[0][0].F)


@pytest.mark.parametrize("subject", few(SUBJECTS, 0, 4, 9))
def test_parts_touch_in_the_last_six_poses_alone(meshes, subject):
    rest, *posed = meshes[subject]
    count = [int(self_intersecting(mesh).sum()) for mesh in (rest, *posed)]
    assert count[:5] == [0] * 5
    # One body's crossed arms do not reach each other.
    assert sum(k > 0 for k in count[5:]) >= 5 and max(count) < 600
    for mesh in posed[4:]:
        assert mesh.V[:, 1].min() == pytest.approx(0.0, abs=1e-6)
        # Of what lies inside another part there is little: points under the skin that the surface winds
        # around twice, by area.
        inner = mesh.V[mesh.F].mean(axis=1) - 1e-3 * mesh.face_normals
        twice = igl.fast_winding_number(mesh.V, mesh.F, inner) > 1.5
        assert mesh.face_areas[twice].sum() < 0.03 * mesh.area


def test_the_last_six_poses_are_what_they_are_called(meshes):
    at = load_bodies().landmarks
    sides = [{name: at[f"{name}_{side}"] for name in ("hand", "hip", "elbow", "shoulder", "knee", "toe")}
             for side in "lr"]  # fmt: skip
    for rest, *posed in meshes.values():
        size = np.ptp(rest.V[:, 1])
        hips, raised, together, one_leg, sitting, crossed = (mesh.V / size for mesh in posed[4:])
        for name in sides:
            hand, elbow = name["hand"], name["elbow"]
            assert np.linalg.norm(hips[hand] - hips[name["hip"]]) < 0.1
            assert abs(hips[elbow, 0]) > abs(hips[hand, 0]) + 0.03 and hips[elbow, 2] < hips[hand, 2]
            assert raised[hand, 1] > raised[elbow, 1] > raised[name["shoulder"], 1]
            assert np.linalg.norm(raised[hand] - raised[at["head_top"]]) < 0.12
            assert together[hand, 2] > together[name["shoulder"], 2] + 0.25
            assert one_leg[hand, 1] > one_leg[at["head_top"], 1]
            assert np.linalg.norm(sitting[hand] - sitting[name["knee"]]) < 0.12
            assert sitting[name["knee"], 2] > sitting[name["hip"], 2] + 0.15
            assert abs(sitting[name["knee"], 1] - sitting[name["hip"], 1]) < 0.1
            assert crossed[hand, 0] * crossed[elbow, 0] < 0  # beyond the body's middle
        left, right = sides
        assert np.linalg.norm(together[left["hand"]] - together[right["hand"]]) < 0.1
        assert np.linalg.norm(one_leg[left["hand"]] - one_leg[right["hand"]]) < 0.15
        assert one_leg[left["toe"], 1] > 0.1 > one_leg[right["toe"], 1]


def test_squat_keeps_the_feet(meshes):
    source = SyntheticBodies()
    feet = [source.landmark_vertices(0)[name] for name in ("toe_l", "toe_r", "heel_l", "heel_r")]
    for rest, _, _, squat, *_ in meshes.values():
        assert np.linalg.norm(squat.V[feet] - rest.V[feet], axis=1).max() < 0.01
        assert np.ptp(rest.V[:, 1]) - squat.V[:, 1].max() > 0.05


def test_landmarks_lie_where_their_names_say():
    rest = SyntheticBodies().rest(0)
    at = {name: rest.V[v] for name, v in load_bodies().landmarks.items()}
    assert len(at) == len(set(load_bodies().landmarks.values())) == 31
    for name in at:
        if name.endswith("_l"):  # the person's left is at +x, and both sides mirror each other
            right = at[f"{name[:-2]}_r"]
            assert at[name][0] > 0
            np.testing.assert_allclose(at[name] * [-1, 1, 1], right, atol=0.03)
    assert at["head_top"][1] == pytest.approx(rest.V[:, 1].max(), abs=2e-3)
    assert at["chest"][2] > 0.05 + at["upper_back"][2]
    assert at["toe_l"][2] > 0.15 + at["heel_l"][2]
    assert at["nose"][1] > at["chest"][1] > at["hip_l"][1] > at["knee_l"][1] > at["heel_l"][1]


def test_zero_pose_is_the_rest_pose():
    bodies = load_bodies()
    V = bodies.pose(3, rotations=np.zeros_like(bodies.rotations[0, 0]), shift=np.zeros(3))
    np.testing.assert_allclose(V, bodies.rest[3], atol=1e-13)


def test_root_rotation_is_a_rigid_motion():
    bodies = load_bodies()
    rotations = np.zeros_like(bodies.rotations[0, 0])
    rotations[0] = [0.4, 2.1, -0.7]
    shift = np.array([0.1, -0.2, 0.3])
    R, pivot = Rotation.from_rotvec(rotations[0]).as_matrix(), bodies.joints[2, 0]
    expected = (bodies.rest[2] - pivot) @ R.T + pivot + shift
    np.testing.assert_allclose(bodies.pose(2, rotations=rotations, shift=shift), expected, atol=1e-13)


def test_bone_motions_follow_the_chain():
    joints = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    rotations = np.array([[0, 0, np.pi / 2], [0, 0, np.pi / 2]])
    motions = bone_motions(joints, np.array([-1, 0]), rotations=rotations)
    # The elbow goes to (0, 1, 0); what was one unit beyond it turns half a turn in all.
    np.testing.assert_allclose(apply_motions(motions[[1]], np.array([[2.0, 0, 0]])), [[-1, 1, 0]], atol=1e-15)


def test_skinning_does_not_collapse_under_twist():
    # Half way between no rotation and a half turn lies a quarter turn; linear blending would give radius 0.
    motions = bone_motions(
        np.zeros((2, 3)), np.array([-1, 0]), rotations=np.array([[0, 0, 0], [np.pi - 1e-9, 0, 0]])
    )
    V = np.array([[0.5, 1.0, 0.0]])
    half = np.full((1, 2), 0.5)
    out = apply_motions(blend_motions(motions, bone=np.array([[0, 1]]), weight=half), V)
    np.testing.assert_allclose(out, [[0.5, 0.0, 1.0]], atol=1e-8)


def test_poses_and_landmarks_of_the_source():
    source = SyntheticBodies()
    poses = source.poses(0)
    assert tuple(p.name for p in poses) == APART + TOUCHING
    assert [p.name for p in poses if not p.aligned] == ["bend_twist"]
    assert all(p.landmarks == source.base_landmarks for p in poses if p.aligned)
    assert tuple(source.landmark_vertices(4)) == source.landmark_names
    assert poses[0] == SourcePose("arms_up", source.base_landmarks)
    assert [p.name for p in SyntheticBodies(poses_used=["squat"]).poses(0)] == ["squat"]
    for call in (source.rest, source.poses, source.landmark_vertices):
        with pytest.raises(InputError, match="no synthetic subject 10"):
            call(10)
