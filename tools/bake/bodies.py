"""Make the asset of the synthetic bodies: ``python -m tools.bake bodies [--mpfb2 DIR] --out FILE``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from defaust.build.upsample import self_intersecting
from defaust.sources.bodies import Bodies
from defaust.sources.source import read_asset
from defaust.sources.synthetic import SHA256, decode
from defaust.tasks.full_size import interpolation
from sshade import InputError, Mesh
from tools.bake.landmarks import find_landmarks
from tools.bake.morphs import (
    BONES,
    PARAMETERS,
    Shape,
    morph,
    read_base,
    read_joints,
    read_parents,
    read_weights,
)
from tools.bake.poses import POSES, REACHES, make_pose
from tools.bake.template import (
    fill,
    make_template,
    outer_skin,
    quantise_weights,
    smooth_weights,
    without_intersections,
)

SEED = 0
SUBJECTS = tuple(Shape(*values) for values in PARAMETERS["subjects"])


def bake(root: Path | None) -> dict[str, np.ndarray]:
    """Make the arrays of the asset from the folder of MPFB2's data.

    Without a folder, the bodies of the package and their first four poses are kept, and the other poses are
    made from bake.yaml.

    Raises
    ------
    InputError
        When a subject intersects itself at rest after smoothing, or in a pose at half of its angles.
    """
    if root is None:
        return add_poses(without_reaches(read_asset("bodies", sha256=SHA256)))
    base = read_base(root)
    body = base.F.max() + 1
    neutral = morph(root, base, shape=Shape())
    skin = base.F[outer_skin(neutral[:body], base.F)]
    T, TF = make_template(neutral[:body], skin)
    matrix, distance = interpolation(T, neutral[:body], skin)
    on_skin = distance < 1e-6

    joint_ids = read_joints(root, base)
    steps, joints = [], []
    for shape in SUBJECTS:
        V = morph(root, base, shape=shape)
        shaped = T + fill(matrix @ (V - neutral)[:body], on_skin, T=T, TF=TF)
        floor = np.array([0.0, shaped[:, 1].min(), 0.0])
        steps.append(without_intersections(shaped - floor, TF))
        joints.append([V[joint_ids[bone][0]].mean(axis=0) - floor for bone in BONES])
    W = fill(matrix @ read_weights(root, len(base.V))[:body], on_skin, T=T, TF=TF)
    bone, weight = quantise_weights(smooth_weights(W, TF))

    mean = np.round(np.mean(steps, axis=0)).astype(np.int32)
    landmarks = find_landmarks(
        T,
        TF,
        heads={name: neutral[head].mean(axis=0) for name, (head, _) in joint_ids.items()},
        tails={name: neutral[tail].mean(axis=0) for name, (_, tail) in joint_ids.items()},
    )
    arrays = {
        "mean": mean,
        "offset": (np.array(steps) - mean).astype(np.int16),
        "faces": TF.astype(np.uint16),
        "joints": np.array(joints, dtype=np.float32),
        "parents": read_parents(root).astype(np.int8),
        "bones": np.array(BONES),
        "bone": bone,
        "weight": weight,
        "rotations": np.zeros((len(SUBJECTS), 0, len(BONES), 3), dtype=np.float32),
        "shifts": np.zeros((len(SUBJECTS), 0, 3), dtype=np.float32),
        "pose_names": np.array([], dtype=str),
        "landmarks": np.array(list(landmarks.values()), dtype=np.uint16),
        "landmark_names": np.array(list(landmarks)),
    }
    return add_poses(arrays)


def add_poses(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Append the poses of bake.yaml that an asset lacks.

    The angles of a pose are reduced until the skinned body does not intersect itself. Poses in
    :data:`REACHES` are meant to touch and keep their angles.

    Raises
    ------
    InputError
        When a subject intersects itself in a pose at half of its angles.
    """
    bodies = decode(arrays)
    added = [name for name in POSES if name not in bodies.pose_names]
    rotations = np.zeros((len(bodies.rest), len(added), len(BONES), 3), dtype=np.float32)
    shifts = np.zeros((len(bodies.rest), len(added), 3), dtype=np.float32)
    for s in range(len(bodies.rest)):
        for k, name in enumerate(added):
            rotations[s, k], shifts[s, k] = _find_pose(bodies, subject=s, name=name)
    return {
        **arrays,
        "rotations": np.concatenate([arrays["rotations"], rotations], axis=1),
        "shifts": np.concatenate([arrays["shifts"], shifts], axis=1),
        "pose_names": np.array([*bodies.pose_names, *added]),
    }


def without_reaches(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Remove the poses in :data:`REACHES` from an asset."""
    kept = [k for k, name in enumerate(arrays["pose_names"]) if name not in REACHES]
    chosen = {name: arrays[name][:, kept] for name in ("rotations", "shifts")}
    return {**arrays, **chosen, "pose_names": arrays["pose_names"][kept]}


def _find_pose(bodies: Bodies, *, subject: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (b, 3) and shift (3,) of a pose, in float32 as stored."""
    for factor in np.linspace(1.0, 0.5, 26):
        rotations, shift = make_pose(
            name,
            joints=bodies.joints[subject],
            parents=bodies.parents,
            seed=[SEED, subject, list(POSES).index(name)],
            factor=factor,
        )
        if name == "bend_twist" or name in REACHES:  # put on the floor
            shift[1] = -bodies.pose(subject, rotations=rotations, shift=shift)[:, 1].min()
        # Test the rounded values, which are stored.
        stored = rotations.astype(np.float32), shift.astype(np.float32)
        V = bodies.pose(subject, rotations=stored[0].astype(np.float64), shift=stored[1].astype(np.float64))
        if name in REACHES or not self_intersecting(Mesh(V, bodies.faces)).any():
            return stored
    raise InputError(f"subject {subject} intersects itself in {name} even at half the angles")
