"""Scans and models as others published them, with whole regions as handles: koala, cat, hand, armadillo.

The first three ship with the package; the armadillo is read from a folder of the user's. Regions and poses
are this project's own and stand in data/scans.yaml. What is known of a pose are its regions alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from defaust.folder.layout import sha256
from defaust.sources.files import existing
from defaust.sources.packing import STEPS, unpack
from defaust.sources.source import Region, SourcePose
from sshade import InputError, Mesh
from sshade.io.meshes import read_mesh

#: Of each scan its credits, what tells that it is this mesh, its regions and its poses.
SCANS: Mapping[str, Mapping[str, Any]] = yaml.safe_load(
    resources.files("defaust").joinpath("data/scans.yaml").read_text(encoding="utf-8")
)
NAMES = tuple(SCANS)
#: Those of the package; the others are files of the user's.
SHIPPED = tuple(name for name in NAMES if "asset_sha256" in SCANS[name])
#: Formats, of those that keep the order of vertices and faces, in which others are looked for.
SUFFIXES = (".ply", ".obj", ".off")


@dataclass(frozen=True)
class Scans:
    """Source of the scans; a subject is one of :data:`NAMES`.

    Parameters
    ----------
    root : path, optional
        Folder of the scans that may not be shipped, such as ``armadillo.ply``; without it there
        are those of the package alone.

    Raises
    ------
    InputError
        When the folder is missing or holds none of them.
    """

    root: str | None = None
    name: str = field(default="scans", init=False)

    def __post_init__(self) -> None:
        if self.root is not None and self.subjects == tuple(map(NAMES.index, SHIPPED)):
            wanted = " or ".join(f"{name}.ply" for name in NAMES if name not in SHIPPED)
            raise InputError(f"{self.root}: holds no {wanted}; without source.root the other scans are built")

    @property
    def subjects(self) -> tuple[int, ...]:
        """Numbers of the scans that are there."""
        return tuple(s for s, name in enumerate(NAMES) if name in SHIPPED or self._file(name))

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """The regions of all scans, whether they are there or not."""
        return tuple(dict.fromkeys(region for scan in SCANS.values() for region in scan["regions"]))

    @property
    def provenance(self) -> Mapping[str, Any]:
        """For the dataset card; the scans' own credits."""
        own = [NAMES[s] for s in self.subjects]
        return {
            "title": "scans",
            "origin": "; ".join(f"{name}: {SCANS[name]['origin']}" for name in own)
            + "; as collected in https://github.com/odedstein/meshes",
            "licence": "; ".join(f"{name}: {SCANS[name]['licence']}" for name in own),
            "citation": "; ".join(f"{name}: {SCANS[name]['credit']}" for name in own),
            "limits": [
                "Koala and cat were published as meshes, scanned or modelled; the hand is of a model that "
                "was learned from scans; the armadillo is a range scan. All were remeshed.",
                "No true pose is known: of a pose, only the regions that are held or moved.",
                "Regions and poses are this project's choice.",
                f"The scans of the package are rounded to a lattice of {STEPS} steps along their longest "
                "side, and renumbered.",
            ],
            "axes": "y up",
            "unit": "none (each scan's own)",
            "classes": list(NAMES),
            "scans": {name: dict(SCANS[name]) for name in own},
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of the user's files; those of the package's are among the facts."""
        files = [self._file(NAMES[s]) for s in subjects if NAMES[s] not in SHIPPED]
        return {file.name: sha256(file) for file in files if file is not None}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """None: landmarks are regions."""
        return {}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The poses of a scan."""
        self._require(subject)
        name = NAMES[subject]
        V = self.rest(subject).V
        poses = SCANS[name]["poses"]
        return tuple(SourcePose(pose, *_regions(SCANS[name]["regions"], poses[pose], V)) for pose in poses)

    def rest(self, subject: int) -> Mesh:
        """The scan."""
        self._require(subject)
        name = NAMES[subject]
        if name in SHIPPED:
            return shipped(name)
        file = self._file(name)
        if file is None:
            raise InputError(f"{self.root}: holds no {name}.ply any more")
        return _recognised(file, name)

    def posed(self, subject: int, pose: SourcePose) -> None:
        """None: what is known are the regions."""

    def _require(self, subject: int) -> None:
        if subject not in self.subjects:
            raise InputError(f"there is no subject {subject}; they are {list(self.subjects)}")

    def _file(self, name: str) -> Path | None:
        if self.root is None:
            return None
        folder = existing(self.root, option="source.root to the folder that holds armadillo.ply")
        files = [folder / f"{name}{suffix}" for suffix in SUFFIXES]
        return next((file for file in files if file.is_file()), None)


@cache
def shipped(name: str) -> Mesh:
    """A scan of the installed package.

    Parameters
    ----------
    name : str
        One of :data:`SHIPPED`.

    Returns
    -------
    Mesh
        Closed and manifold, one component.

    Raises
    ------
    InputError
        When the checksum of its asset is not the recorded one.
    """
    path = resources.files("defaust") / "data" / f"{name}.npz"
    found, known = hashlib.sha256(path.read_bytes()).hexdigest(), SCANS[name]["asset_sha256"]
    if found != known:
        raise InputError(f"{path} is damaged: its sha256 is {found}, not {known}; reinstall the package")
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return Mesh(*unpack(arrays))


def identity(mesh: Mesh) -> dict[str, Any]:
    """What tells a mesh from others, in whatever unit and format: its faces, and where its extremes lie.

    Returns
    -------
    dict
        ``vertices``: how many, ``faces_sha256``: of the faces as little-endian int64, and ``extremes``:
        the vertices of lowest, then of highest x, y and z.
    """
    low, high = mesh.V.argmin(axis=0), mesh.V.argmax(axis=0)
    return {
        "vertices": mesh.n,
        "faces_sha256": hashlib.sha256(mesh.F.astype("<i8").tobytes()).hexdigest(),
        "extremes": [*low.tolist(), *high.tolist()],
    }


def _recognised(file: Path, name: str) -> Mesh:
    """The mesh of a file, which must be the one that the regions were chosen on."""
    mesh, wanted = read_mesh(file), SCANS[name]["identity"]
    if identity(mesh) != wanted:
        raise InputError(
            f"{file}: is another mesh, of {mesh.n:,} vertices, than the {name} of {wanted['vertices']:,} in "
            "https://github.com/odedstein/meshes, or the same turned or numbered anew; the regions fit that "
            "one alone"
        )
    return mesh


def _regions(
    regions: Mapping[str, Any], pose: Mapping[str, Any], V: np.ndarray
) -> tuple[tuple[str, ...], bool, tuple[Region, ...]]:
    """Names, whether the pose is aligned with the rest pose, and regions of a pose.

    Boxes and pivots are fractions of the bounding box of V (n, 3), shifts are multiples of its diagonal.
    """
    low = V.min(axis=0)
    size = V.max(axis=0) - low
    motions: dict[str, tuple[np.ndarray, np.ndarray]] = {
        name: (np.eye(3), np.zeros(3)) for name in pose["held"]
    }
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
    return tuple(region.landmark for region in found), True, tuple(found)
