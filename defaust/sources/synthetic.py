"""Synthetic bodies in correspondence, from the asset that :mod:`defaust.bake` made.

Ten adults with FAUST's counts (6890 vertices, 13776 faces), a rest pose and
ten target poses each: nothing touches in the first four, parts touch and cross
a little in the others. Metres, y up, facing +z, feet on y = 0.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from types import MappingProxyType

import numpy as np

from defaust.sources.choices import OneTemplate, require_choice
from defaust.sources.skinning import apply_motions, blend_motions, bone_motions
from defaust.sources.source import SourcePose
from sshade import InputError, Mesh

#: Length of one step of the stored integers, in metres.
QUANTUM = 2e-5
#: Of the asset; a new bake changes it.
SHA256 = "b85c3dfd44ed40ddfbdba348a8f7275fa96dc03c34a3c0f00612eb84b75db1e9"

BASE_LANDMARKS = ("nose", "hand_l", "hand_r", "toe_l", "toe_r", "heel_l", "heel_r")
MORE_LANDMARKS = (
    *("elbow_l", "elbow_r", "knee_l", "knee_r", "hip_l", "hip_r"),
    *("chest", "upper_back"),
)
#: Poses that are turned against the rest pose.
UNALIGNED = ("bend_twist",)
#: For the dataset card.
FACTS = {
    "title": "synthetic bodies",
    "origin": (
        "MakeHuman/MPFB2 base mesh, macro targets and game-engine rig, morphed to ten adults, "
        "closed, decimated to 6890 vertices and posed by dual quaternion skinning"
    ),
    "licence": "CC0 1.0 Universal (see the NOTICE file of the package)",
    "citation": "MakeHuman community, base mesh hm08 and its targets, CC0 since September 2020",
    "limits": [
        "The bodies are synthetic: no scan, no hair, neutral faces, closed mouth and eyes.",
        "Skinning stands for soft tissue: shoulders bulge when the arms go up, creases stretch.",
        "In the first four poses no part touches another; in the others parts touch and cross a little, but "
        "for the crossed arms of subject 6.",
        "Fingers and toes are thin; remeshed below about 100,000 vertices they are coarse.",
    ],
    "axes": "y up, facing +z, the person's left at +x",
    "unit": "metre",
    "asset_sha256": SHA256,
}


@dataclass(frozen=True, eq=False)
class Bodies:
    """The asset, decoded.

    rest (s, n, 3) float64 metres; faces (m, 3) int64; joints (s, b, 3);
    parents (b,); bone, weight (n, 4); rotations (s, p, b, 3) radians about
    world axes; shifts (s, p, 3) metres; landmarks: name -> vertex.
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
        return cls(
            rest=QUANTUM * (arrays["mean"].astype(np.int64) + arrays["offset"]),
            faces=arrays["faces"].astype(np.int64),
            joints=arrays["joints"].astype(np.float64),
            parents=arrays["parents"].astype(np.int64),
            bone=arrays["bone"].astype(np.int64),
            weight=arrays["weight"] / 255.0,
            rotations=arrays["rotations"].astype(np.float64),
            shifts=arrays["shifts"].astype(np.float64),
            pose_names=tuple(str(name) for name in arrays["pose_names"]),
            landmarks=dict(
                zip(map(str, arrays["landmark_names"]), map(int, arrays["landmarks"]), strict=True)
            ),
        )

    def pose(self, subject: int, *, rotations: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """(n, 3) vertices of a subject under any rotations (b, 3) and shift (3,)."""
        return apply_motions(self.motions(subject, rotations=rotations), self.rest[subject]) + shift

    def motions(self, subject: int, *, rotations: np.ndarray) -> np.ndarray:
        """(n, 8) dual quaternion that moves each vertex of a subject under any rotations (b, 3)."""
        motions = bone_motions(self.joints[subject], self.parents, rotations=rotations)
        return blend_motions(motions, bone=self.bone, weight=self.weight)


@cache
def load_bodies() -> Bodies:
    """Read and decode the asset of the installed package; InputError when it is damaged."""
    return Bodies.from_arrays(read_asset())


def read_asset() -> dict[str, np.ndarray]:
    """Read the arrays of the asset of the installed package.

    Raises
    ------
    InputError
        When its checksum is not the recorded one.
    """
    path = resources.files("defaust") / "data" / "bodies.npz"
    data = path.read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != SHA256:
        raise InputError(f"{path} is damaged: its sha256 is {found}, not {SHA256}; reinstall the package")
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)


@dataclass(frozen=True)
class SyntheticBodies(OneTemplate):
    """Source of the ten synthetic adults.

    Parameters
    ----------
    base_landmarks : sequence of str
        Landmarks with handles in every pose.
    more_landmarks : sequence of str
        Added in the pose that is not aligned with the rest pose.
    poses_used : sequence of str, optional
        Names of the target poses, in order; by default all of the asset.

    Raises
    ------
    InputError
        On an unknown or repeated landmark or pose.
    """

    base_landmarks: tuple[str, ...] = BASE_LANDMARKS
    more_landmarks: tuple[str, ...] = MORE_LANDMARKS
    poses_used: tuple[str, ...] | None = None
    name: str = field(default="synthetic", init=False)

    subjects = tuple(range(10))
    provenance = MappingProxyType(FACTS)

    def __post_init__(self) -> None:
        self._check_landmarks()
        known = load_bodies().pose_names
        used = known if self.poses_used is None else self.poses_used
        object.__setattr__(self, "poses_used", require_choice(used, known=known, option="source.poses_used"))

    @property
    def landmarks(self) -> Mapping[str, int]:
        """Vertex of each landmark of the asset."""
        return load_bodies().landmarks

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """None: the asset's own checksum is one of the facts."""
        return {}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The target poses of the asset."""
        return self._poses(subject, ((name, name not in UNALIGNED) for name in self.poses_used))

    def rest(self, subject: int) -> Mesh:
        """Rest mesh."""
        self._require(subject)
        bodies = load_bodies()
        return Mesh(bodies.rest[subject], bodies.faces)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Posed mesh, by dual quaternion skinning."""
        self._require(subject)
        bodies = load_bodies()
        k = bodies.pose_names.index(pose.name)
        V = bodies.pose(subject, rotations=bodies.rotations[subject, k], shift=bodies.shifts[subject, k])
        return Mesh(V, bodies.faces)
