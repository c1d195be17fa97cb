"""Published scans and models with whole regions as handles: koala, cat, hand, armadillo.

The package ships koala, cat and hand; the armadillo is read from the user's folder. data/scans.yaml holds the
regions and poses, which are this project's choice. The true poses are unknown.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from defaust.folder.layout import sha256
from defaust.sources.files import MESH_SUFFIXES, existing
from defaust.sources.source import Region, Source, SourcePose, provenance_texts, read_asset, read_yaml
from sshade import InputError, Mesh
from sshade.io.meshes import read_mesh

#: Credits, identity, regions and poses of each scan.
SCANS: Mapping[str, Mapping[str, Any]] = read_yaml("scans")
NAMES = tuple(SCANS)
#: Scans that the package ships; the user has the others.
SHIPPED = tuple(name for name in NAMES if "asset_sha256" in SCANS[name])
#: Number of steps of the asset's lattice along the longest side of the bounding box.
STEPS = 2**16 - 1


@dataclass(frozen=True)
class Scans(Source):
    """Source of the scans; a subject is an index into :data:`NAMES`.

    Parameters
    ----------
    root : path, optional
        Folder of scans that cannot be shipped, such as ``armadillo.ply``. By default only the shipped scans
        are built.

    Raises
    ------
    InputError
        When the folder is missing or holds no such scan.
    """

    root: str | None = None

    name = "scans"

    def __post_init__(self) -> None:
        if self.root is not None and self.subjects == tuple(map(NAMES.index, SHIPPED)):
            wanted = " or ".join(f"{name}.ply" for name in NAMES if name not in SHIPPED)
            raise InputError(f"{self.root}: holds no {wanted}; without source.root the other scans are built")

    @property
    def subjects(self) -> tuple[int, ...]:
        """Numbers of the available scans."""
        return tuple(s for s, name in enumerate(NAMES) if name in SHIPPED or self._file(name))

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Regions of all scans, available or not."""
        return tuple(dict.fromkeys(region for scan in SCANS.values() for region in scan["regions"]))

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the dataset card, including the credits of each scan."""
        return self.provenance_of(self.subjects)

    def provenance_of(self, subjects: Sequence[int]) -> Mapping[str, Any]:
        """Facts for the card of a dataset of some scans, which has the credits of no other scan."""
        texts, names = provenance_texts("scans"), [NAMES[s] for s in subjects]
        origin, licence, citation = (
            "; ".join(f"{name}: {SCANS[name][fact]}" for name in names)
            for fact in ("origin", "licence", "credit")
        )
        return {
            **{name: text for name, text in texts.items() if name != "kinds"},
            "origin": f"{origin}; as collected in https://github.com/odedstein/meshes",
            "licence": licence,
            "citation": citation,
            "limits": [
                limit.format(steps=STEPS, kinds="; ".join(f"{n}: {texts['kinds'][n]}" for n in names))
                for limit in texts["limits"]
            ],
            "classes": list(NAMES),
            "scans": {name: dict(SCANS[name]) for name in names},
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of the user's files; `provenance` holds the checksums of the shipped scans."""
        files = [self._file(NAMES[s]) for s in subjects if NAMES[s] not in SHIPPED]
        return {file.name: sha256(file) for file in files if file is not None}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The poses of a scan."""
        scan, V = SCANS[NAMES[subject]], self.rest(subject).V
        regions = {pose: _regions(scan["regions"], content, V) for pose, content in scan["poses"].items()}
        return tuple(
            SourcePose(pose, tuple(region.landmark for region in found), regions=found)
            for pose, found in regions.items()
        )

    def rest(self, subject: int) -> Mesh:
        """The scan; a file of the user must hold the mesh that the regions were chosen on."""
        name = NAMES[subject]
        if name in SHIPPED:
            return shipped(name)
        file = self._file(name)
        if file is None:
            raise InputError(f"{self.root}: no longer holds {name}.ply")
        mesh, wanted = read_mesh(file), SCANS[name]["identity"]
        if identity(mesh) != wanted:
            raise InputError(
                f"{file}: has {mesh.n:,} vertices and is not the {name} with {wanted['vertices']:,} vertices "
                "of https://github.com/odedstein/meshes; use that file, neither rotated nor renumbered, "
                "because the regions fit no other mesh"
            )
        return mesh

    def posed(self, subject: int, pose: SourcePose) -> None:
        """None: only the regions are known."""

    def _file(self, name: str) -> Path | None:
        if self.root is None:
            return None
        folder = existing(self.root, option="source.root to the folder that holds armadillo.ply")
        files = [folder / f"{name}{suffix}" for suffix in MESH_SUFFIXES]
        return next((file for file in files if file.is_file()), None)


@cache
def shipped(name: str) -> Mesh:
    """Read a scan of the installed package: a closed manifold of one component.

    Parameters
    ----------
    name : str
        Name in :data:`SHIPPED`.

    Raises
    ------
    InputError
        When the asset's checksum differs from the recorded one.
    """
    return Mesh(*unpack(read_asset(name, sha256=SCANS[name]["asset_sha256"])))


def unpack(arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Decode an asset.

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


def identity(mesh: Mesh) -> dict[str, Any]:
    """Describe a mesh in a way that does not depend on its unit and file format.

    Returns
    -------
    dict
        ``vertices``: the number of vertices. ``faces_sha256``: checksum of the faces as little-endian int64.
        ``extremes``: the vertices of lowest, then of highest x, y and z.
    """
    low, high = mesh.V.argmin(axis=0), mesh.V.argmax(axis=0)
    return {
        "vertices": mesh.n,
        "faces_sha256": hashlib.sha256(mesh.F.astype("<i8").tobytes()).hexdigest(),
        "extremes": [*low.tolist(), *high.tolist()],
    }


def _regions(regions: Mapping[str, Any], pose: Mapping[str, Any], V: np.ndarray) -> tuple[Region, ...]:
    """Regions of a pose of a scan with vertices V (n, 3); data/scans.yaml says what the numbers mean."""
    low = V.min(axis=0)
    size = V.max(axis=0) - low
    motions: dict[str, tuple[np.ndarray, ...]] = dict.fromkeys(pose["held"], ())
    for move in pose["moved"]:
        axis = np.array(move["axis"], dtype=np.float64)
        R = Rotation.from_rotvec(np.radians(move["degrees"]) * axis / np.linalg.norm(axis)).as_matrix()
        pivot = low + size * move["pivot"]
        shift = np.linalg.norm(size) * np.array(move.get("shift", [0.0, 0.0, 0.0]))
        motions |= dict.fromkeys(move["regions"], (R, pivot - R @ pivot + shift))
    found = []
    for name in (name for name in regions if name in motions):
        corners = (low + size * np.array(regions[name])).tolist()
        boxes = tuple((tuple(a), tuple(b)) for a, b in corners)
        found.append(Region(name, boxes, *motions[name]))
    return tuple(found)
