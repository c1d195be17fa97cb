"""Ten synthetic adults in vertex correspondence.

Each has FAUST's counts (6890 vertices, 13776 faces), a rest pose and ten target poses. In the first four
target poses nothing touches. In the others, parts of the body touch and cross a little. The unit is the
metre; y points up, the bodies face +z, and the feet stand on y = 0. :mod:`tools.bake` made the asset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from defaust.sources.choices import OneTemplate, require_choice
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import SourcePose, provenance_texts, read_asset
from sshade import Mesh

#: Unit of the stored integer coordinates, in metres.
QUANTUM = 2e-5
#: Checksum of the asset; a new bake changes it.
SHA256 = "b85c3dfd44ed40ddfbdba348a8f7275fa96dc03c34a3c0f00612eb84b75db1e9"

#: Poses that are turned as a whole against the rest pose.
UNALIGNED = ("bend_twist",)


@dataclass(frozen=True, eq=False)
class Bodies:
    """The decoded asset of s subjects, n vertices, b bones and p poses.

    Attributes
    ----------
    rest : (s, n, 3) float64
        Rest positions in metres.
    faces : (m, 3) int64
    joints : (s, b, 3) float64
        Joint that each bone turns about, in metres.
    parents : (b,) int64
        Parent of each bone, -1 at the root.
    bone, weight : (n, 4)
        Bones of each vertex, and their weights.
    rotations : (s, p, b, 3) float64
        Rotation vectors about world axes, in radians.
    shifts : (s, p, 3) float64
        Translations of the whole body, in metres.
    pose_names : tuple of str
    landmarks : mapping
        Vertex of each landmark.
    """

    rest: np.ndarray
    faces: np.ndarray
    joints: np.ndarray
    parents: np.ndarray
    bone: np.ndarray
    weight: np.ndarray
    rotations: np.ndarray
    shifts: np.ndarray
    pose_names: tuple[str, ...]
    landmarks: Mapping[str, int]

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Bodies:
        """Decode the arrays of the asset."""
        rest = QUANTUM * (arrays["mean"].astype(np.int64) + arrays["offset"])
        return cls.rigged(rest, arrays["faces"].astype(np.int64), arrays)

    @classmethod
    def rigged(cls, rest: np.ndarray, faces: np.ndarray, arrays: Mapping[str, np.ndarray]) -> Bodies:
        """Decode the arrays of the rig, the poses and the landmarks of some shapes (s, n, 3)."""
        return cls(
            rest=rest,
            faces=faces,
            joints=arrays["joints"].astype(np.float64),
            parents=arrays["parents"].astype(np.int64),
            bone=arrays["bone"].astype(np.int64),
            weight=arrays["weight"] / 255.0,
            rotations=arrays["rotations"].astype(np.float64),
            shifts=arrays["shifts"].astype(np.float64),
            pose_names=tuple(arrays["pose_names"].tolist()),
            landmarks=dict(zip(arrays["landmark_names"].tolist(), arrays["landmarks"].tolist(), strict=True)),
        )

    def pose(self, subject: int, *, rotations: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Vertices (n, 3) of a subject posed by bone rotations (b, 3) and a shift (3,)."""
        return apply_motions(self.motions(subject, rotations=rotations), self.rest[subject]) + shift

    def motions(self, subject: int, *, rotations: np.ndarray) -> np.ndarray:
        """Dual quaternion (n, 8) of each vertex of a subject posed by bone rotations (b, 3)."""
        motions = bone_motions(self.joints[subject], self.parents, rotations=rotations)
        return blend_motions(motions, bone=self.bone, weight=self.weight)


@cache
def load_bodies() -> Bodies:
    """Read and decode the asset of the installed package; raise InputError when it is damaged."""
    return Bodies.from_arrays(read_asset("bodies", sha256=SHA256))


@dataclass(frozen=True)
class SyntheticBodies(OneTemplate):
    """Source of the ten synthetic adults.

    Parameters
    ----------
    poses_used : sequence of str, optional
        Names of the target poses, in order; by default all poses of the asset.

    Raises
    ------
    InputError
        On an unknown or repeated pose.
    """

    poses_used: tuple[str, ...] | None = None

    name = "synthetic"
    subjects = tuple(range(10))
    base_landmarks = ("nose", "hand_l", "hand_r", "toe_l", "toe_r", "heel_l", "heel_r")
    more_landmarks = ("elbow_l", "elbow_r", "knee_l", "knee_r", "hip_l", "hip_r", "chest", "upper_back")

    def __post_init__(self) -> None:
        known = load_bodies().pose_names
        used = known if self.poses_used is None else self.poses_used
        object.__setattr__(self, "poses_used", require_choice(used, known=known, option="source.poses_used"))

    @property
    def provenance(self) -> Mapping[str, object]:
        """Facts for the dataset card."""
        return {**provenance_texts("synthetic"), "asset_sha256": SHA256}

    @property
    def landmarks(self) -> Mapping[str, int]:
        """Vertex of each landmark of the asset."""
        return load_bodies().landmarks

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The chosen target poses."""
        return self._poses((name, name not in UNALIGNED) for name in self.poses_used)

    def rest(self, subject: int) -> Mesh:
        """Rest mesh."""
        bodies = load_bodies()
        return Mesh(bodies.rest[subject], bodies.faces)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Posed mesh, by dual quaternion skinning."""
        bodies = load_bodies()
        k = bodies.pose_names.index(pose.name)
        V = bodies.pose(subject, rotations=bodies.rotations[subject, k], shift=bodies.shifts[subject, k])
        return Mesh(V, bodies.faces)
