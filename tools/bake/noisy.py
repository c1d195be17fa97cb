"""Make the poses of the noisy bodies: ``python -m tools.bake noisy --out FILE``.

Wrists and ankles bend, heads turn, and hands rest on the body. Inverse kinematics place the hands on each
subject.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import igl
import numpy as np
import yaml
from scipy.optimize import least_squares

from defaust.sources.bodies import Bodies
from defaust.sources.noisy import ANGLE, LENGTH
from defaust.sources.skinning import apply_motions, bone_motions
from defaust.sources.synthetic import load_bodies
from tools.bake.morphs import BONES
from tools.bake.poses import JITTER, _both_sides

SEED = 35
POSES: dict[str, dict[str, dict[str, Any]]] = yaml.safe_load(
    Path(__file__).with_name("noisy.yaml").read_text(encoding="utf-8")
)
#: Subjects by the key of their poses in noisy.yaml.
SUBJECTS = {"tuning": range(5), "others": range(5, 10)}
ARM = ("clavicle", "upperarm", "lowerarm", "hand")
#: Height of the back of a hand above the surface, in metres.
HAND = 0.03
#: Radius over which the normal of the surface under a hand is averaged, in metres.
PALM = 0.05
#: Weights of the residuals: place of the hand and of the elbow per metre, directions of palm and fingers, and
#: rotation of each bone of the arm per radian.
AT, ELBOW, PALM_WEIGHT, FINGERS, EFFORT = 40.0, 4.0, 1.2, 0.6, (0.4, 0.12, 0.2, 0.5)


@dataclass(frozen=True)
class Grip:
    """Goal of a hand: place of its back, directions of its back and fingers, and place of the elbow."""

    side: str
    at: np.ndarray
    normal: np.ndarray
    fingers: np.ndarray
    elbow: np.ndarray


def make_pose(bodies: Bodies, *, subject: int, pose: Mapping[str, Any], seed: list[int]) -> tuple[Any, Any]:
    """Rotations (b, 3) of the bones and shift (3,) of a subject in a pose, feet on the ground."""
    rng = np.random.default_rng(seed)
    rotations = np.zeros((len(BONES), 3))
    for bone, angles in _both_sides(pose["bones"]).items():
        rotations[BONES.index(bone)] = np.radians(np.array(angles) + JITTER * rng.normal(size=3))
    without_arms = bodies.pose(subject, rotations=rotations, shift=np.zeros(3))
    for side, goal in _hands(pose.get("hands", {})):
        grip = _grip(bodies, without_arms, rotations, subject=subject, side=side, goal=goal)
        _reach(bodies, rotations, subject=subject, grip=grip)
    lowest = bodies.pose(subject, rotations=rotations, shift=np.zeros(3))[:, 1].min()
    return rotations, np.array([0.0, -lowest, 0.0])


def _hands(hands: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    if "both" in hands:
        return [("l", hands["both"]), ("r", hands["both"])]
    return [(side[0], goal) for side, goal in hands.items()]


def _grip(
    bodies: Bodies, V: np.ndarray, rotations: np.ndarray, *, subject: int, side: str, goal: Mapping[str, Any]
) -> Grip:
    """Goal of a hand on the body (n, 3), which is posed except for the arms."""
    mirror = np.array([1.0 if side == "l" else -1.0, 1.0, 1.0])
    at = mirror * goal["offset"]
    for name, weight in goal["at"].items():
        at = at + weight * V[bodies.landmarks.get(name) or bodies.landmarks[f"{name}_{side}"]]
    if "normal" in goal:
        normal = mirror * goal["normal"]
    else:
        arms = [BONES.index(f"{bone}_{s}") for bone in ARM[1:] for s in "lr"]
        body = (np.isin(bodies.bone, arms) * bodies.weight).sum(axis=1) < 0.1
        nearest = np.argmin(np.where(body, np.linalg.norm(V - at, axis=1), np.inf))
        near = body & (np.linalg.norm(V - V[nearest], axis=1) < PALM)
        normal = igl.per_vertex_normals(V, bodies.faces)[near].mean(axis=0)
        normal /= np.linalg.norm(normal)
        at = V[nearest] + HAND * normal
    fingers = mirror * goal["fingers"]
    fingers -= (fingers @ normal) * normal
    motions = bone_motions(bodies.joints[subject], bodies.parents, rotations=rotations)
    arm = BONES.index(f"upperarm_{side}")
    shoulder = apply_motions(motions[[bodies.parents[arm]]], bodies.joints[subject, [arm]])[0]
    return Grip(side, at, normal, fingers / np.linalg.norm(fingers), shoulder + mirror * goal["elbow"])


def _reach(bodies: Bodies, rotations: np.ndarray, *, subject: int, grip: Grip) -> None:
    """Rotate the bones of an arm, so that its hand reaches a goal."""
    joints, rest, side = bodies.joints[subject], bodies.rest[subject], grip.side
    arm = [BONES.index(f"{bone}_{side}") for bone in ARM]
    vertex = {name: bodies.landmarks[f"{name}_{side}"] for name in ("hand", "wrist", "fingertip")}
    fingers = rest[vertex["fingertip"]] - rest[vertex["wrist"]]
    back = igl.per_vertex_normals(rest, bodies.faces)[vertex["hand"]]
    points = np.stack([rest[vertex["hand"]], back, fingers])

    def residuals(x: np.ndarray) -> np.ndarray:
        rotations[arm] = x.reshape(-1, 3)
        motions = bone_motions(joints, bodies.parents, rotations=rotations)
        at, ends, origin = (
            apply_motions(motions[[arm[3]] * len(P)], P)
            for P in (points[:1], points[1:] + joints[arm[3]], joints[[arm[3]]])
        )
        directions = (ends - origin) / np.linalg.norm(ends - origin, axis=1, keepdims=True)
        elbow = apply_motions(motions[[arm[1]]], joints[[arm[2]]])[0]
        return np.concatenate(
            [
                AT * (at[0] - grip.at),
                PALM_WEIGHT * (directions[0] - grip.normal),
                FINGERS * (directions[1] - grip.fingers),
                ELBOW * (elbow - grip.elbow),
                (np.array(EFFORT)[:, None] * rotations[arm]).ravel(),
            ]
        )

    best = min(
        (least_squares(residuals, start) for start in _starts(side)), key=lambda solution: solution.cost
    )
    residuals(best.x)


def _starts(side: str) -> list[np.ndarray]:
    """Starts of the optimiser: the arm at rest, and the elbow bent forward."""
    outward = 1.0 if side == "l" else -1.0
    bent = np.zeros((4, 3))
    bent[1] = [0.2, 0.0, -0.3 * outward]
    bent[2] = [-0.9, -0.6 * outward, 0.0]
    return [np.zeros(12), bent.ravel()]


def bake(_: Path | None) -> dict[str, np.ndarray]:
    """Make the arrays of the asset."""
    bodies = load_bodies()
    count = len(bodies.rest)
    names, rotations, shifts = [], np.zeros((count, 5, len(BONES), 3)), np.zeros((count, 5, 3))
    for key, poses in POSES.items():
        for s in SUBJECTS[key]:
            names.append(list(poses))
            for k, pose in enumerate(poses.values()):
                rotations[s, k], shifts[s, k] = make_pose(bodies, subject=s, pose=pose, seed=[SEED, s, k])
    return {
        "names": np.array(names),
        "rotations": np.round(rotations / ANGLE).astype(np.int16),
        "shifts": np.round(shifts / LENGTH).astype(np.int16),
    }
