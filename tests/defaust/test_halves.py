"""Held out means other bodies and other poses, by the shipped meshes and by the names of the poses."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.configuration import CONFIGURATION, configure
from defaust.sources.synthetic import SyntheticBodies
from eval.rows.splits import HELD_OUT, TUNING, split_of
from sshade.mesh.rigid import rigid_motion

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
