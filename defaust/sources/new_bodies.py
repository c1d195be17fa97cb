"""Five new synthetic adults in six new poses, on which no constant of a method was chosen.

Their faces, rig and landmarks are those of :mod:`defaust.sources.synthetic`, shapes and poses are others.
:mod:`tools.bake.new_bodies` made the asset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

from defaust.sources.bodies import Bodies
from defaust.sources.noisy import ANGLE, LENGTH
from defaust.sources.source import SourcePose, provenance_texts, read_asset
from defaust.sources.synthetic import QUANTUM, Adults, load_bodies

#: Checksum of the asset; a new bake changes it.
SHA256 = "03672091240f4a4a68b7ff07992a5c036676ab93250496ebe15e9f2a44c83856"
#: Numbers of the bodies. They follow those of the ten bodies of the source `synthetic`.
SUBJECTS = tuple(range(10, 15))

#: Poses that are turned as a whole against the rest pose.
UNALIGNED = ("crawling",)


@cache
def load_new_bodies() -> Bodies:
    """Read and decode the asset of the installed package; raise InputError when it is damaged."""
    rig, arrays = load_bodies(), read_asset("new_bodies", sha256=SHA256)
    return replace(
        rig,
        rest=rig.rest[0] + QUANTUM * arrays["offset"],
        joints=arrays["joints"].astype(float),
        rotations=ANGLE * arrays["rotations"],
        shifts=LENGTH * arrays["shifts"],
        pose_names=tuple(arrays["pose_names"].tolist()),
    )


@dataclass(frozen=True)
class NewBodies(Adults):
    """Source of the five new synthetic adults."""

    name = "new_bodies"
    subjects = SUBJECTS

    @property
    def provenance(self) -> Mapping[str, object]:
        """Facts for the dataset card."""
        return {**provenance_texts("new_bodies"), "asset_sha256": SHA256}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The six target poses."""
        return self._poses((name, name not in UNALIGNED) for name in load_new_bodies().pose_names)

    def body(self, subject: int) -> tuple[Bodies, int]:
        """The five bodies, and a subject's row there."""
        return load_new_bodies(), subject - SUBJECTS[0]
