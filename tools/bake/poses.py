"""Target poses, as rotations of the bones about world axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from defaust.sources.skinning import apply_motions, bone_motions
from tools.bake.morphs import BONES, PARAMETERS

#: Rotation vectors in degrees, by pose and bone; see bake.yaml.
POSES: dict[str, dict[str, list[float]]] = PARAMETERS["poses"]
#: Targets of wrists and elbows in the poses that bring parts together; see bake.yaml.
REACHES: dict[str, dict[str, Any]] = PARAMETERS["reaches"]
#: Standard deviation of angles between subjects, in degrees.
JITTER = 3.0
#: Standard deviation of the elbow targets between subjects, in metres.
ELBOW_JITTER = 0.01
#: Weights of inverse kinematics: errors of wrist and elbow per metre, and rotation of each bone per radian.
WRIST, ELBOW = 30.0, 6.0
ARM = {"clavicle": 0.35, "upperarm": 0.15, "lowerarm": 0.25}
#: Motion of the whole body in bend_twist: lean (x, z), then turn (y), in degrees; shift in metres.
TURN = Rotation.from_euler("YXZ", (125.0, 14.0, 10.0), degrees=True).as_rotvec()
TURN_SHIFT = np.array([0.55, 0.0, 0.35])
#: Shift of the pelvis in the squat, as a multiple of the leg's length.
SQUAT_SHIFT = np.array([0.0, -0.22, -0.13])


def make_pose(
    name: str, *, joints: np.ndarray, parents: np.ndarray, seed: list[int], factor: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Make a pose of a subject.

    Parameters
    ----------
    name : str
        Key of :data:`POSES`.
    joints : (b, 3) float64
    parents : (b,) int
    seed : list of int
        Seed of the jitter, which differs between subjects.
    factor : float
        Factor of every angle except the turn of the whole body and arms that reach; 1 is the full pose.

    Returns
    -------
    rotations : (b, 3) float64, radians
    shift : (3,) float64, metres
    """
    rng = np.random.default_rng(seed)
    rotations = np.zeros((len(BONES), 3))
    for bone, angles in _both_sides(POSES[name]).items():
        rotations[BONES.index(bone)] = factor * np.radians(np.array(angles) + JITTER * rng.normal(size=3))
    shift = np.zeros(3)
    if name == "squat":
        leg = joints[BONES.index("thigh_l"), 1] - joints[BONES.index("foot_l"), 1]
        shift = factor * leg * SQUAT_SHIFT
        for side in "lr":
            _plant(rotations, joints, parents=parents, shift=shift, side=side)
    elif name == "bend_twist":
        rotations[0] = TURN
        shift = TURN_SHIFT.copy()
    elif name in REACHES:
        posed = _posed_joints(rotations, joints, parents=parents)  # before the arms move
        for side in "lr":
            elbow_shift = ELBOW_JITTER * rng.normal(size=3)
            wrist, elbow = _arm_targets(REACHES[name], posed, side=side)
            _reach(rotations, joints, parents=parents, wrist=wrist, elbow=elbow + elbow_shift, side=side)
    return rotations, shift


def _posed_joints(rotations: np.ndarray, joints: np.ndarray, *, parents: np.ndarray) -> np.ndarray:
    """Joint positions (b, 3) in a pose. Each joint moves with its parent; the root's joint stays."""
    motions = bone_motions(joints, parents, rotations=rotations)
    return np.concatenate([joints[:1], apply_motions(motions[parents[1:]], joints[1:])])


def _arm_targets(reach: dict[str, Any], posed: np.ndarray, *, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Targets of a wrist and an elbow: joints plus offsets outward, up and forward, mirrored on the right."""
    outward = np.array([1.0 if side == "l" else -1.0, 1.0, 1.0])
    near = reach["near"] if reach["near"] in BONES else f"{reach['near']}_{side}"
    wrist = posed[BONES.index(near)] + outward * reach["wrist"]
    if side == "l":
        wrist += reach.get("left_wrist", np.zeros(3))
    return wrist, posed[BONES.index(f"upperarm_{side}")] + outward * reach["elbow"]


def _reach(
    rotations: np.ndarray,
    joints: np.ndarray,
    *,
    parents: np.ndarray,
    wrist: np.ndarray,
    elbow: np.ndarray,
    side: str,
) -> None:
    """Rotate the bones of an arm so that its wrist reaches a target and its elbow is near another."""
    arm = [BONES.index(f"{bone}_{side}") for bone in ARM]
    effort = np.array(list(ARM.values()))[:, None]

    def residuals(x: np.ndarray) -> np.ndarray:
        rotations[arm] = x.reshape(-1, 3)
        posed = _posed_joints(rotations, joints, parents=parents)
        at_wrist = WRIST * (posed[BONES.index(f"hand_{side}")] - wrist)
        at_elbow = ELBOW * (posed[BONES.index(f"lowerarm_{side}")] - elbow)
        return np.concatenate([at_wrist, at_elbow, (effort * rotations[arm]).ravel()])

    residuals(least_squares(residuals, np.zeros(3 * len(arm))).x)


def _plant(
    rotations: np.ndarray, joints: np.ndarray, *, parents: np.ndarray, shift: np.ndarray, side: str
) -> None:
    """Rotate the bones of a leg so that its foot keeps its rest position."""
    thigh, calf, foot = (BONES.index(f"{bone}_{side}") for bone in ("thigh", "calf", "foot"))
    outward = 1.0 if side == "l" else -1.0
    start = np.radians([-75.0, outward * 8.0, outward * 10.0, 80.0])

    def place(x: np.ndarray) -> np.ndarray:
        rotations[thigh], rotations[calf] = x[:3], (x[3], 0.0, 0.0)
        motions = bone_motions(joints, parents, rotations=rotations)
        ankle = apply_motions(motions[[calf]], joints[[foot]])[0] + shift - joints[foot]
        # The ankle leaves one degree of freedom open: stay near the start.
        return np.concatenate([1e3 * ankle, 0.1 * (x - start)])

    place(least_squares(place, start).x)
    # Undo the rotation of the chain, so that the foot keeps its rest orientation.
    real = bone_motions(joints, parents, rotations=rotations)[calf, :4]
    rotations[foot] = Rotation.from_quat(real, scalar_first=True).inv().as_rotvec()


def _both_sides(pose: dict[str, list[float]]) -> dict[str, tuple[float, float, float]]:
    """Angles of each bone. Names without a side stand for both; the right side is mirrored."""
    full = {}
    for bone, (x, y, z) in pose.items():
        if bone in BONES:
            full[bone] = (x, y, z)
        else:
            full[f"{bone}_l"], full[f"{bone}_r"] = (x, y, z), (x, -y, -z)
    return full
