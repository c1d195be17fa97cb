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

from defaust.sources.bodies import Bodies, SkinnedSource
from defaust.sources.choices import OneTemplate, require_choice
from defaust.sources.source import SourcePose, provenance_texts, read_asset

#: Unit of the stored integer coordinates, in metres.
QUANTUM = 2e-5
#: Checksum of the asset; a new bake changes it.
SHA256 = "b85c3dfd44ed40ddfbdba348a8f7275fa96dc03c34a3c0f00612eb84b75db1e9"

#: Poses that are turned as a whole against the rest pose.
UNALIGNED = ("bend_twist",)


@cache
def load_bodies() -> Bodies:
    """Read and decode the asset of the installed package; raise InputError when it is damaged."""
    return decode(read_asset("bodies", sha256=SHA256))


def decode(arrays: Mapping[str, np.ndarray]) -> Bodies:
    """Decode the arrays of the asset."""
    rest = QUANTUM * (arrays["mean"].astype(np.int64) + arrays["offset"])
    return Bodies.rigged(rest, arrays["faces"].astype(np.int64), arrays)


class Adults(OneTemplate, SkinnedSource):
    """A source of adults with the template and the landmarks of the ten bodies."""

    base_landmarks = ("nose", "hand_l", "hand_r", "toe_l", "toe_r", "heel_l", "heel_r")
    more_landmarks = ("elbow_l", "elbow_r", "knee_l", "knee_r", "hip_l", "hip_r", "chest", "upper_back")

    def landmark_vertices(self, subject: int) -> dict[str, int]:
        """The same vertices on every subject."""
        landmarks = load_bodies().landmarks
        return {name: landmarks[name] for name in self.landmark_names}

    def body(self, subject: int) -> tuple[Bodies, int]:
        """The ten bodies, and a subject's row there."""
        return load_bodies(), subject


@dataclass(frozen=True)
class SyntheticBodies(Adults):
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

    def __post_init__(self) -> None:
        known = load_bodies().pose_names
        used = known if self.poses_used is None else self.poses_used
        object.__setattr__(self, "poses_used", require_choice(used, known=known, option="source.poses_used"))

    @property
    def provenance(self) -> Mapping[str, object]:
        """Facts for the dataset card."""
        return {**provenance_texts("synthetic"), "asset_sha256": SHA256}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The chosen target poses."""
        assert self.poses_used is not None, "__post_init__ replaces None"
        return self._poses((name, name not in UNALIGNED) for name in self.poses_used)
