"""The shipped bodies and animals: assets, skinning, noise, the tools that baked them, and halves."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.configuration import CONFIGURATION, configure
from defaust.sources import noisy
from defaust.sources.animals import SPECIES, Animals, arrays_of, load_animal
from defaust.sources.new_bodies import NewBodies
from defaust.sources.noisy import NoisyBodies, correlated_noise
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import read_asset
from defaust.sources.synthetic import SHA256, SyntheticBodies, load_bodies
from defaust.tasks import load_task
from eval.rows.splits import HELD_OUT, TUNING, split_of
from sshade import InputError
from sshade.mesh.rigid import rigid_motion
from tests.defaust.toy import change
from tests.full import few
from tools.bake.animals import bone_weights, find_landmarks, make_poses, read_table
from tools.bake.bodies import add_poses, without_reaches
from tools.bake.capsules import make_rig
from tools.bake.template import quantise_weights

BODIES, NEW = SyntheticBodies(), NewBodies()
#: Sources, each with a subject and the steps of subdivision.
BUILT = {"new": (NEW, 12, 0), "noisy": (NoisyBodies(noise=4.0), 5, 0), "animals": (Animals(), 1, 1)}


@pytest.mark.parametrize("subject", few([*BODIES.subjects, *NEW.subjects], 4, 12))
def test_bodies_are_closed_and_in_correspondence(subject):
    source = BODIES if subject in BODIES.subjects else NEW
    rest, *posed = [source.rest(subject), *(source.posed(subject, pose) for pose in source.poses(subject))]
    assert 1.4 < np.ptp(rest.V[:, 1]) < 1.95
    crossed = [self_intersecting(mesh).mean() for mesh in (rest, *posed)]
    assert crossed[0] == 0 and max(crossed) < 0.05
    if source is BODIES:  # the first four poses touch nothing
        assert max(crossed[:5]) == 0 and np.count_nonzero(crossed[5:]) >= 5
    for mesh in (rest, *posed):
        assert (mesh.n, mesh.m) == (6890, 13776) and mesh.topology == (2, 1, 0)
        assert mesh.is_closed and mesh.is_manifold and mesh.is_oriented
        assert 0.04 < mesh.volume < 0.1 and abs(mesh.volume / rest.volume - 1) < 0.08
        assert mesh.face_areas.min() > 1e-8
        assert mesh.V[:, 1].min() == pytest.approx(0.0, abs=2e-4) or mesh is not rest
        np.testing.assert_array_equal(mesh.F, BODIES.rest(0).F)
    assert source.landmark_vertices(subject) == BODIES.landmark_vertices(0)
    assert [p.name for p in source.poses(subject) if not p.aligned] in (["bend_twist"], ["crawling"])


def test_assets_are_read_and_decoded_once(monkeypatch):
    for _ in range(2):
        for source in (BODIES, NEW, EXACT, Animals()):
            subject = source.subjects[0]
            source.posed(subject, source.poses(subject)[0])
            assert source.body(subject)[0] is source.body(subject)[0]
        monkeypatch.setattr(np, "load", None)
    with pytest.raises(InputError, match="bodies.npz is damaged: its sha256 is "):
        read_asset("bodies", sha256="0")


def test_bones_follow_the_chain_and_a_twist_does_not_collapse():
    joints, half_turn = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.pi - 1e-9
    motions = bone_motions(joints, np.array([-1, 0]), rotations=np.array([[0, 0, np.pi / 2]] * 2))
    # The elbow moves to (0, 1, 0); the point one unit beyond it turns by half a turn.
    np.testing.assert_allclose(apply_motions(motions[[1]], np.array([[2.0, 0, 0]])), [[-1, 1, 0]], atol=1e-15)
    # The mean of no rotation and a half turn is a quarter turn; linear blending would give radius 0.
    motions = bone_motions(0 * joints, np.array([-1, 0]), rotations=np.array([[0, 0, 0], [half_turn, 0, 0]]))
    blended = blend_motions(motions, bone=np.array([[0, 1]]), weight=np.full((1, 2), 0.5))
    np.testing.assert_allclose(apply_motions(blended, np.array([[0.5, 1.0, 0]])), [[0.5, 0, 1]], atol=1e-8)


@pytest.mark.full
def test_the_shipped_poses_can_be_baked_again_from_the_shipped_bodies():
    arrays = read_asset("bodies", sha256=SHA256)
    first = arrays | {name: arrays[name][:1] for name in ("offset", "joints", "rotations", "shifts")}
    again = add_poses(without_reaches(first))
    assert again.keys() == arrays.keys()
    np.testing.assert_array_equal(again["pose_names"], arrays["pose_names"])
    for name in ("rotations", "shifts"):
        np.testing.assert_allclose(again[name], first[name], atol=1e-4)


@pytest.mark.parametrize("name", few(BUILT, "noisy"))
def test_a_build_is_sound_and_high_and_low_resolution_have_one_true_pose(name, tmp_path):
    source, subject, steps = BUILT[name]
    options = BuildOptions(subjects=(subject,), target_vertices=8000, ls3_steps=steps)
    build(source, tmp_path / "out", options=options, workers=1)
    assert verify(tmp_path / "out") == []
    exact = NoisyBodies(noise=0.0) if isinstance(source, NoisyBodies) else source
    for k, pose in list(enumerate(source.poses(subject), start=1))[::3]:
        high = load_task(tmp_path / "out", subject=subject, pose=k)
        low = load_task(tmp_path / "out", subject=subject, pose=k, resolution="low")
        np.testing.assert_allclose(low.truth, exact.posed(subject, pose).V, atol=1e-12)
        assert high.meta["posed_by"] == "skinning" and high.meta["n_dynamic"] >= 30
        # Nearest vertices at rest stay near each other.
        gap, nearest = cKDTree(high.mesh.V).query(low.mesh.V)
        there = np.linalg.norm(high.truth[nearest] - low.truth, axis=1)
        assert gap.mean() < 0.01 and there.mean() < 2 * gap.mean() + 1e-4 * low.mesh.diagonal
    change(tmp_path / "out", lambda document: document["source"].update(asset_sha256="0" * 64))
    task = load_task(tmp_path / "out", subject=subject, pose=1)
    assert task.truth is None and "of another version (asset 000000000000)" in task.meta["no_truth"]


@pytest.mark.parametrize("subject", Animals.subjects)
def test_animals_are_closed_without_handles_or_intersections_at_rest(subject):
    rest = Animals().rest(subject)
    assert rest.is_closed and rest.is_manifold and rest.is_oriented and rest.volume > 0
    assert rest.topology == (2, 1, 0) and not self_intersecting(rest).any()
    assert rest.n == pytest.approx(read_table()[SPECIES[subject]]["vertices"], rel=0.05)
    assert rest.V[:, 1].min() == pytest.approx(0.0, abs=0.01 * rest.diagonal)


@pytest.mark.parametrize("species", SPECIES)
def test_weights_poses_and_landmarks_of_the_asset_can_be_baked_again(species):
    arrays, animal, table = arrays_of(species), load_animal(species), read_table()[species]
    rig = make_rig(table)
    V, F = animal.rest[0], animal.faces
    # The vertices lie on the surface of the formulas.
    assert np.abs(rig.level(V)).max() < 0.01 * np.linalg.norm(np.ptp(V, axis=0))
    bone, weight = quantise_weights(bone_weights(rig, V, F), keep=arrays["bone"].shape[1])
    assert np.abs(weight.astype(int) - arrays["weight"]).max() <= 1
    rotations, shifts = make_poses(rig, table["poses"])
    np.testing.assert_allclose(rotations, arrays["rotations"], atol=1e-6)
    np.testing.assert_allclose(shifts, arrays["shifts"], atol=1e-6)
    assert find_landmarks(V, table["landmarks"]) == dict(animal.landmarks)


EXACT = NoisyBodies(noise=0.0)


def displaced(source, subject, k):
    """Displacement (n, 3) of the vertices of a pose by its noise, in metres."""
    pose = source.poses(subject)[k]
    return source.posed(subject, pose).V - EXACT.posed(subject, pose).V


def test_the_noise_has_the_asked_size_and_the_rest_mesh_has_none():
    moved = 1000 * displaced(NoisyBodies(noise=3.0), 3, 1)
    assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(3.0)
    assert np.abs(moved.mean(axis=0)).max() < 0.3  # no shift of the body as a whole
    np.testing.assert_array_equal(NoisyBodies(noise=4.0).rest(7).V, SyntheticBodies().rest(7).V)


def test_the_noise_is_alike_nearby_and_independent_farther_away():
    V = load_bodies().rest[0]
    noise = np.stack([correlated_noise(V, rms=1.0, seed=[k]) for k in range(8)], axis=1)
    pairs = cKDTree(V).query_pairs(0.06, output_type="ndarray")
    distance = np.linalg.norm(V[pairs[:, 0]] - V[pairs[:, 1]], axis=1)
    product = (noise[pairs[:, 0]] * noise[pairs[:, 1]]).sum(axis=2).mean(axis=1)
    for low, high, least, most in ((0, 0.006, 0.9, 1.1), (0.013, 0.017, 0.5, 0.7), (0.05, 0.06, -0.05, 0.05)):
        assert least < product[(distance >= low) & (distance < high)].mean() < most


def test_noise_depends_on_seed_subject_and_pose(monkeypatch):
    alike = SimpleNamespace(rest=np.broadcast_to(load_bodies().rest[0], load_bodies().rest.shape))
    monkeypatch.setattr(noisy, "load_bodies", lambda: alike)  # bodies of one shape would get one field
    first = displaced(NoisyBodies(), 0, 0)
    np.testing.assert_array_equal(first, displaced(NoisyBodies(), 0, 0))
    for other in (NoisyBodies(seed=1), 0, 0), (NoisyBodies(), 1, 0), (NoisyBodies(), 0, 1):
        assert abs(np.corrcoef(displaced(*other).ravel(), first.ravel())[0, 1]) < 0.2
    assert len({NoisyBodies(noise, seed).name for noise in (2.0, 2.0000001) for seed in (0, 1)}) == 4


def test_the_truth_is_exact_the_handles_have_the_noise_and_the_card_says_so(tmp_path):
    source, options = NoisyBodies(noise=4.0), BuildOptions(subjects=(5,), target_vertices=None)
    build(source, tmp_path / "out", options=options, workers=1)
    task = load_task(tmp_path / "out", subject=5, pose=1)
    assert task.meta["posed_by"] == "skinning"
    moved = task.handles.dynamic
    missed = task.handles.target[moved] - task.truth[task.handles.index[moved]]
    np.testing.assert_allclose(missed, displaced(source, 5, 0)[task.handles.index[moved]], atol=1e-12)
    assert 0.002 < np.sqrt((missed**2).sum(axis=1).mean()) < 0.006
    card = (tmp_path / "out/README.md").read_text(encoding="utf-8")
    assert "4 mm of noise" in card and "as ground truth" not in card


#: Sources without files of a user.
SHIPPED = [p.stem for p in CONFIGURATION.glob("source/*.yaml") if "root: ???" not in p.read_text()]
SHIPPED.remove("tosca")  # its root is in sequence.yaml
#: Angle in degrees by which a tenth of the surface is turned otherwise: less for two bodies in one pose.
SAME_POSE = 34.0
#: Mean distance of two bodies, x the diagonal, above which they are not one body.
SAME_BODY = 0.004


@pytest.fixture(scope="module")
def cases():
    """By half: pairs (source, subject) -> the poses of the subject in this half."""
    found = {TUNING: {}, HELD_OUT: {}}
    for name in SHIPPED:
        source = configure([f"source={name}", "out=unused"]).source
        for subject in source.subjects:
            for k, pose in enumerate(source.poses(subject), start=1):
                half = split_of(f"defaust-{source.name}/subject_{subject:02d}/pose_{k}")
                if half:
                    found[half].setdefault((source, subject), []).append(pose)
    return found


def same_template(cases, names=("synthetic", "new_bodies", "noisy_2mm")):
    """By half: the subjects whose meshes have the faces of the bodies."""
    return [{key: own for key, own in half.items() if key[0].name in names} for half in cases.values()]


def test_held_out_bodies_are_other_bodies_than_those_of_tuning_cases(cases):
    tuning, held_out = ([(s, source.rest(s)) for source, s in half] for half in cases.values())
    pairs = [(s, t, a, b) for (s, a), (t, b) in product(held_out, tuning) if np.array_equal(a.F, b.F)]
    assert len(pairs) > 20
    for s, t, ours, theirs in pairs:
        R, shift = rigid_motion(ours.V, theirs.V)
        apart = np.linalg.norm(ours.V @ R.T + shift - theirs.V, axis=1).mean() / ours.diagonal
        assert apart > SAME_BODY, (s, t)


@pytest.mark.full
def test_no_held_out_pose_turns_the_surface_as_a_tuning_pose_does(cases):
    tuning, held_out = (
        {(pose.name, s): normals(source, s, pose) for (source, s), own in half.items() for pose in own}
        for half in same_template(cases)
    )
    first = {name: normal for (name, _), normal in reversed(tuning.items())}
    for ((name, s), a), (other, b) in product(held_out.items(), first.items()):
        assert turned(a, b) > SAME_POSE, (name, s, other)
    # The measure finds two bodies in one pose.
    assert max(turned(a, first[name]) for (name, _), a in tuning.items()) < SAME_POSE


def normals(source, subject, pose):
    """Normals of every fourth face of a posed body."""
    return source.posed(subject, pose).face_normals[::4]


def turned(a, b):
    """Angle in degrees by which a tenth of the surface is turned otherwise, after a rotation of the whole."""
    share = SyntheticBodies().rest(0).face_areas[::4]
    aligned = Rotation.align_vectors(a, b, share)[0].apply(b)
    angle = np.arccos(np.clip((a * aligned).sum(axis=1), -1, 1))
    order = np.argsort(-angle)
    return np.degrees(angle[order][np.searchsorted(np.cumsum(share[order]), 0.1 * share.sum())])
