"""Bodies with a skeleton, and the sources that pose them by skinning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import Source, SourcePose
from sshade import Mesh


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


class SkinnedSource(Source):
    """A source of bodies that come with the package."""

    def body(self, subject: int) -> tuple[Bodies, int]:
        """Bodies that contain a subject, and its row there."""
        raise NotImplementedError

    def stance(self, subject: int, pose: str) -> tuple[np.ndarray, np.ndarray]:
        """Rotation vectors (b, 3) of a subject's bones in a pose, in radians, and shift (3,) in metres."""
        bodies, row = self.body(subject)
        k = bodies.pose_names.index(pose)
        return bodies.rotations[row, k], bodies.shifts[row, k]

    def motions(self, subject: int, pose: str) -> tuple[np.ndarray, np.ndarray]:
        """Dual quaternion (n, 8) of each vertex of a subject in a pose, and shift (3,) of the whole body."""
        bodies, row = self.body(subject)
        rotations, shift = self.stance(subject, pose)
        return bodies.motions(row, rotations=rotations), shift

    def rest(self, subject: int) -> Mesh:
        """Rest mesh."""
        bodies, row = self.body(subject)
        return Mesh(bodies.rest[row], bodies.faces)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Posed mesh, by dual quaternion skinning."""
        bodies, row = self.body(subject)
        motions, shift = self.motions(subject, pose.name)
        return Mesh(apply_motions(motions, bodies.rest[row]) + shift, bodies.faces)
