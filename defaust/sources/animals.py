"""Four animals in vertex correspondence with their poses: a cat, a horse, an elephant and a lizard.

Each species has its own mesh, a rest pose and four target poses. The unit is the metre; y points up, the
animals face +z, and their feet stand on y = 0. :mod:`tools.bake.animals` made the asset from formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from defaust.sources.bodies import Bodies, SkinnedSource
from defaust.sources.source import SourcePose, provenance_texts, read_asset

#: Species, in the order of the subjects.
SPECIES = ("cat", "horse", "elephant", "lizard")
#: Checksum of the asset; a new bake changes it.
SHA256 = "69c8a02f0c09d0c1f3772acbfc24773d1a2873d2b5abdadbb3be30de57c7f1fa"

#: Landmarks with handles in every pose, and additional ones where the whole animal is turned.
BASE = ("nose", "ear_l", "ear_r", "forefoot_l", "forefoot_r", "hindfoot_l", "hindfoot_r", "tail_tip")
MORE = ("shoulder_l", "shoulder_r", "hip_l", "hip_r", "back")


def unpack(arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Decode a mesh of the asset.

    Parameters
    ----------
    arrays : mapping
        ``corner`` (3,) and ``step`` () float64: the lattice. ``vertices`` (b, n, 3) and ``faces`` (b, m, 3)
        uint8: differences of successive integers, one array for each of the b bytes.

    Returns
    -------
    V : (n, 3) float64
    F : (m, 3) int64
    """
    V = arrays["corner"] + arrays["step"] * np.cumsum(_integers(arrays["vertices"]), axis=0)
    F = _integers(arrays["faces"])
    F[:, 0] = np.cumsum(F[:, 0])
    return V, np.cumsum(F, axis=1)


def _integers(planes: np.ndarray) -> np.ndarray:
    """Signed integers (k, 3) from their bytes (b, k, 3); odd numbers encode negative integers."""
    unsigned = sum(plane.astype(np.int64) << 8 * k for k, plane in enumerate(planes))
    return np.where(unsigned & 1, -(unsigned >> 1) - 1, unsigned >> 1)


def decode(arrays: Mapping[str, np.ndarray]) -> Bodies:
    """Decode the arrays of a species as bodies with one subject."""
    V, F = unpack(arrays)
    of_subject = {name: arrays[name][None] for name in ("joints", "rotations", "shifts")}
    return Bodies.rigged(V[None], F, {**arrays, **of_subject})


@cache
def _asset() -> dict[str, np.ndarray]:
    return read_asset("animals", sha256=SHA256)


def arrays_of(species: str) -> dict[str, np.ndarray]:
    """Read the arrays of a species of the installed package; raise InputError when the asset is damaged."""
    start = f"{species}."
    return {name.removeprefix(start): a for name, a in _asset().items() if name.startswith(start)}


@cache
def load_animal(species: str) -> Bodies:
    """Read and decode a species of the installed package; raise InputError when the asset is damaged."""
    return decode(arrays_of(species))


@dataclass(frozen=True)
class Animals(SkinnedSource):
    """Source of the four animals; it has no parameters."""

    name = "animals"
    subjects = tuple(range(len(SPECIES)))
    landmark_names = (*BASE, *MORE)

    @property
    def provenance(self) -> Mapping[str, object]:
        """Facts for the dataset card."""
        return {**provenance_texts("animals"), "classes": list(SPECIES), "asset_sha256": SHA256}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The four poses of a species."""
        turned = arrays_of(SPECIES[subject])["turned"]
        return tuple(
            SourcePose(name, self.landmark_names if whole else BASE, aligned=not whole)
            for name, whole in zip(load_animal(SPECIES[subject]).pose_names, turned.tolist(), strict=True)
        )

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Vertices of a species."""
        landmarks = load_animal(SPECIES[subject]).landmarks
        return {name: landmarks[name] for name in self.landmark_names}

    def body(self, subject: int) -> tuple[Bodies, int]:
        """A species, which has one row."""
        return load_animal(SPECIES[subject]), 0
