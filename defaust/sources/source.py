"""The interface between a source of registered shapes and the build."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sshade import InputError, Mesh

#: Lowest and highest corner.
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class Region:
    """A landmark whose handles are all vertices in some boxes. The region moves rigidly.

    Parameters
    ----------
    landmark : str
    boxes : tuple of boxes
    rotation : (3, 3) float64, optional
    translation : (3,) float64, optional
        A vertex v goes to R v + t. The default keeps it in place.
    """

    landmark: str
    boxes: tuple[Box, ...]
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class SourcePose:
    """A target pose of a subject.

    Parameters
    ----------
    name : str
        Name of the pose in the source.
    landmarks : tuple of str
        Landmarks with handles in this pose.
    aligned : bool, optional
        False if the whole body is turned or moved against the rest pose; None if unknown.
    regions : tuple of Region, optional
        Landmarks whose handles are a region.
    """

    name: str
    landmarks: tuple[str, ...]
    aligned: bool | None = True
    regions: tuple[Region, ...] = ()


class Source:
    """Base class of sources: subjects with a rest pose and target poses in vertex correspondence.

    Subjects are built in worker processes, so a source must pickle. Its meshes depend only on its
    parameters and its data. A subclass may define a property as an attribute.
    """

    @property
    def name(self) -> str:
        """Short identifier, e.g. ``synthetic``."""
        raise NotImplementedError

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the dataset card.

        They are ``title``, ``origin``, ``licence``, ``citation``, ``limits``, ``axes``, ``unit``, and
        everything else that the result depends on, as plain values without paths. ``without`` lists classes
        that the configuration leaves out. ``left_out`` maps the names of other unused data to a reason.
        """
        raise NotImplementedError

    @property
    def subjects(self) -> tuple[int, ...]:
        """Numbers of the subjects."""
        raise NotImplementedError

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Every landmark of every pose, in the order of their ids."""
        raise NotImplementedError

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """Target poses; the dataset counts them from 1."""
        raise NotImplementedError

    def rest(self, subject: int) -> Mesh:
        """Registered rest mesh, in which every vertex has a face; InputError if it cannot be used."""
        raise NotImplementedError

    def posed(self, subject: int, pose: SourcePose) -> Mesh | None:
        """Registered mesh in a target pose, with the faces of the rest mesh.

        None if only the regions of the pose are known; InputError if the pose cannot be used.
        """
        raise NotImplementedError

    @property
    def files(self) -> Iterable[Path]:
        """All files of meshes in the folder of the source, also those that it does not read."""
        return ()

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each file that the subjects are read from, by file name; InputError if one is missing."""
        return {}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Vertex of each landmark that is not a region, on the subject's registered meshes."""
        return {}

    def dropped(self, subject: int) -> Mapping[str, int]:
        """Counts of the vertices and faces in a file that are not part of the surface."""
        return {}

    def generated(self, subject: int, *, vertices: int) -> Mesh | None:
        """Rest mesh of about this many vertices, with the topology of the registered mesh.

        None if the source cannot generate meshes; the build upsamples the registered mesh.
        """
        return None


def provenance_texts(source: str) -> dict[str, Any]:
    """Texts of a source for the dataset card, from data/provenance.yaml."""
    text = resources.files("defaust").joinpath("data/provenance.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text)[source]


def read_asset(name: str, *, sha256: str) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file of the installed package; raise InputError on another checksum."""
    path = resources.files("defaust") / "data" / f"{name}.npz"
    data = path.read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise InputError(f"{path} is damaged: its sha256 is {found}, not {sha256}; reinstall the package")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)
