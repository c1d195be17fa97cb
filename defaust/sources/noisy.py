"""The ten synthetic adults as registrations are: with noise, bent wrists and ankles, and hands on the body.

The bodies are those of :mod:`defaust.sources.synthetic`. The poses are others: subjects 0 to 4 have five
poses, which are for tuning, and subjects 5 to 9 have five others.
:mod:`tools.bake.noisy` made the poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from defaust.schema import mismatch
from defaust.sources.source import SourcePose, provenance_texts, read_asset
from defaust.sources.synthetic import SHA256, Adults, SyntheticBodies, load_bodies
from sshade import InputError, Mesh

#: Units of the stored integers: rotations in radians, shifts in metres.
ANGLE, LENGTH = np.radians(0.01), 1e-4
#: Checksum of the asset of the poses; a new bake changes it.
POSES_SHA256 = "571fc05a34963b728bd5ba6e5a9162ab31f973b599c3822e93c0153a947de500"
#: Length over which the noise is correlated, in metres: at this distance the correlation is 0.61.
CORRELATION = 0.015
#: Number of waves that the noise is the sum of.
WAVES = 400
#: Step of displacements as a fraction of their root mean square, so that last bits do not decide.
STEP = 1e-5


@cache
def _poses() -> dict[str, np.ndarray]:
    """Read the poses of the installed package; raise InputError when they are damaged."""
    return read_asset("poses", sha256=POSES_SHA256)


def pose_names(subject: int) -> list[str]:
    """Names of the poses of a subject, in order."""
    return _poses()["names"][subject].tolist()


def correlated_noise(points: np.ndarray, *, rms: float, seed: list[int]) -> np.ndarray:
    """Displace points as errors of a registration do: alike nearby, independent farther away.

    The noise is a Gaussian random field, whose correlation at a distance d is exp(-d²/2l²) with l =
    :data:`CORRELATION`. A third of its variance moves points along the normal, two thirds along the surface.

    Parameters
    ----------
    points : (n, 3) float64
    rms : float
        Root mean square length of the displacements, in the unit of the points.
    seed : list of int

    Returns
    -------
    (n, 3) float64
        In steps of :data:`STEP`, because last bits of the field depend on the processor.
    """
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(3, WAVES)) / CORRELATION
    phase = rng.uniform(0.0, 2.0 * np.pi, size=WAVES)
    field = np.cos(points @ wave + phase) @ rng.normal(size=(WAVES, 3))
    step = STEP * rms
    return step * np.round(field / (STEP * np.sqrt((field**2).sum(axis=1).mean())))


@dataclass(frozen=True)
class NoisyBodies(Adults):
    """Source of the ten synthetic adults as registrations.

    Every pose has noise: its registered mesh, and with it the targets of the handles, are displaced. The rest
    mesh is exact, because a task begins at the rest mesh whatever its errors are. The noise of a pose
    stands for the difference of the errors of both registrations.

    Parameters
    ----------
    noise : float
        Root mean square displacement of the vertices of a pose, in millimetres; 0 leaves the poses exact.
    seed : int
        Seed of the noise.

    Raises
    ------
    InputError
        When the noise is negative or above 10 mm, or the seed is negative.
    """

    noise: float = 2.0
    seed: int = 0

    subjects = SyntheticBodies.subjects

    def __post_init__(self) -> None:
        given = {"noise": self.noise, "seed": self.seed}
        if problem := mismatch(given, {"noise": float, "seed": int}, "source"):
            raise InputError(problem)
        if not 0 <= self.noise <= 10:
            raise InputError(f"source.noise is {self.noise}; give millimetres from 0 to 10")
        if self.seed < 0:
            raise InputError(f"source.seed is {self.seed}; it must be at least 0")

    @property
    def name(self) -> str:
        """``noisy_2mm``, or ``noisy_2mm_seed1`` with seed 1: two kinds of noise never share a name."""
        short = f"{self.noise:g}"
        level = f"noisy_{short if float(short) == self.noise else repr(self.noise)}mm"
        return f"{level}_seed{self.seed}" if self.seed else level

    @property
    def provenance(self) -> Mapping[str, object]:
        """Facts for the dataset card."""
        texts = provenance_texts("noisy")
        noise, correlation = f"{self.noise:g}", f"{1000 * CORRELATION:g}"
        return {
            **texts,
            "title": texts["title"].format(noise=noise),
            "limits": [limit.format(noise=noise, correlation=correlation) for limit in texts["limits"]],
            "asset_sha256": SHA256,
            "poses_sha256": POSES_SHA256,
            "noise_mm": float(self.noise),
            "noise_seed": self.seed,
        }

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The five target poses of the subject."""
        return self._poses((name, True) for name in pose_names(subject))

    def stance(self, subject: int, pose: str) -> tuple[np.ndarray, np.ndarray]:
        """Rotation vectors (b, 3) of a subject's bones in a pose, in radians, and shift (3,) in metres."""
        k = pose_names(subject).index(pose)
        return ANGLE * _poses()["rotations"][subject, k], LENGTH * _poses()["shifts"][subject, k]

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Posed mesh with noise."""
        mesh = super().posed(subject, pose)
        if self.noise == 0:
            return mesh
        seed = [self.seed, subject, pose_names(subject).index(pose.name)]
        rest = load_bodies().rest[subject]
        return Mesh(mesh.V + correlated_noise(rest, rms=self.noise / 1000, seed=seed), mesh.F)
