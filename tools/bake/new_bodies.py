"""Make the new bodies: ``python -m tools.bake new_bodies --mpfb2 DIR --out FILE``.

The bodies have the faces, the rig and the landmarks of the bodies of the package. Their shapes are other
morphs of the same base mesh, interpolated at the vertices of the first body.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from defaust.sources.bodies import Bodies
from defaust.sources.new_bodies import SUBJECTS
from defaust.sources.noisy import ANGLE, LENGTH
from defaust.sources.synthetic import QUANTUM, load_bodies
from defaust.tasks.full_size import interpolation
from tools.bake.morphs import BONES, PARAMETERS, Shape, morph, read_base, read_joints
from tools.bake.noisy import make_pose
from tools.bake.template import fill, outer_skin, without_intersections

SEED = 66
NEW: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
#: Maximum distance of a vertex of the first body from its morph, in metres. Others close holes.
ON_SKIN = 1e-4


def bake(root: Path) -> dict[str, np.ndarray]:
    """Make the arrays of the asset from the folder of MPFB2's data.

    Raises
    ------
    InputError
        When a subject intersects itself at rest after smoothing.
    """
    rig = load_bodies()
    rest, joints = make_shapes(root, rig)
    bodies = replace(rig, rest=QUANTUM * rest, joints=joints)
    rotations = np.zeros((len(rest), len(NEW["poses"]), len(BONES), 3))
    shifts = np.zeros((len(rest), len(NEW["poses"]), 3))
    for s, subject in enumerate(SUBJECTS):
        for k, pose in enumerate(NEW["poses"].values()):
            rotations[s, k], shifts[s, k] = make_pose(bodies, subject=s, pose=pose, seed=[SEED, subject, k])
    return {
        "offset": (rest - np.round(rig.rest[0] / QUANTUM).astype(np.int64)).astype(np.int16),
        "joints": joints.astype(np.float32),
        "rotations": np.round(rotations / ANGLE).astype(np.int16),
        "shifts": np.round(shifts / LENGTH).astype(np.int16),
        "pose_names": np.array(list(NEW["poses"])),
    }


def make_shapes(root: Path, rig: Bodies) -> tuple[np.ndarray, np.ndarray]:
    """Rest positions (s, n, 3) int64 in multiples of QUANTUM, and joints (s, b, 3), feet on the ground."""
    base = read_base(root)
    body = base.F.max() + 1
    skin = base.F[outer_skin(morph(root, base, shape=Shape())[:body], base.F)]
    joint_ids = [read_joints(root, base)[bone][0] for bone in BONES]
    first = morph(root, base, shape=Shape(*PARAMETERS["subjects"][0]))
    floor = first[joint_ids[0]].mean(axis=0) - rig.joints[0, 0]
    T = rig.rest[0] + floor
    matrix, distance = interpolation(T, first[:body], skin)
    on_skin = distance < ON_SKIN
    rest, joints = [], []
    for values in NEW["subjects"]:
        V = morph(root, base, shape=Shape(*values))
        shaped = T + fill(matrix @ (V - first)[:body], on_skin, T=T, TF=rig.faces)
        floor = np.array([0.0, shaped[:, 1].min(), 0.0])
        rest.append(without_intersections(shaped - floor, rig.faces))
        joints.append([V[ids].mean(axis=0) - floor for ids in joint_ids])
    return np.array(rest), np.array(joints)
