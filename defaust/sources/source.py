"""What a source of registered shapes offers to the build."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sshade import Mesh

#: Lowest and highest corner.
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class Region:
    """A landmark that is all vertices in some boxes, whatever the resolution, moved rigidly.

    Parameters
    ----------
    landmark : str
    boxes : tuple of boxes
    rotation : (3, 3) float64, optional
    translation : (3,) float64, optional
        v goes to R v + t; by default it stays.
    """

    landmark: str
    boxes: tuple[Box, ...]
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class SourcePose:
    """One target pose of a subject.

    Parameters
    ----------
    name : str
        What the source calls it.
    landmarks : tuple of str
        Landmarks that carry handles in this pose.
    aligned : bool, optional
        False where the pose is turned or moved as a whole against the rest pose; None: not known.
    regions : tuple of Region, optional
        Landmarks whose handles are a region, not some vertices near one.
    """

    name: str
    landmarks: tuple[str, ...]
    aligned: bool | None = True
    regions: tuple[Region, ...] = ()


class Source(Protocol):
    """Subjects with a rest pose and target poses in vertex correspondence.

    A source is built with plain parameters and pickles, because subjects are
    built in worker processes. Whatever it returns depends on nothing but its
    parameters and its data.
    """

    @property
    def name(self) -> str:
        """Short identifier, e.g. ``synthetic``."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Flat facts for the dataset card: ``title``, ``origin``, ``licence``, ``citation``, ``limits``,
        ``axes``, ``unit`` and what else the result depends on: text, numbers, or lists
        and mappings of them; no path. ``without`` are the names of classes that were not to be
        taken, ``left_out`` says of others why they are not."""

    @property
    def subjects(self) -> tuple[int, ...]:
        """Numbers of the subjects."""

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Every landmark that some pose uses, in the order of their ids."""

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each file that these subjects are read from, by the file's name; empty where the
        data ship with the package. Raises InputError where a file is missing."""

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Vertex of each landmark that is no region, on the subject's registered meshes."""

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """Target poses; pose k of the dataset is the k-th of them, counted from 1."""

    def rest(self, subject: int) -> Mesh:
        """Registered rest mesh, in which every vertex has a face. InputError where it cannot be used."""

    def posed(self, subject: int, pose: SourcePose) -> Mesh | None:
        """Registered mesh in a target pose, with the faces of the rest mesh; None where all that is
        known of the pose are its regions. InputError where the pose cannot be used."""


@runtime_checkable
class FromFiles(Protocol):
    """A source whose files may hold what is no part of a surface, and is not taken over."""

    def dropped(self, subject: int) -> Mapping[str, int]:
        """How many of what, such as ``unused_vertices``; empty where there is none."""


@runtime_checkable
class Generator(Protocol):
    """A source that makes its rest meshes at any resolution itself, so that none is upsampled."""

    def generated(self, subject: int, *, vertices: int) -> Mesh:
        """Rest mesh of about so many vertices, of the same topology as the registered one."""
