"""The registrations of FAUST, read from the user's own copy.

MPI-FAUST/training/registrations holds a hundred meshes: ten subjects in ten poses. Each has 6890 vertices and
13776 faces, and all share one list of faces. This package contains no data of FAUST.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from defaust.folder.layout import sha256
from defaust.sources.choices import OneTemplate, check_choice, require_choice, require_landmarks, shortened
from defaust.sources.files import MESH_SUFFIXES, SourceShape, existing, mesh_files
from defaust.sources.source import SourcePose, provenance_texts
from sshade import InputError, Mesh

VERTICES, FACES = 6890, 13776
#: Names of FAUST's poses 0 to 9, chosen by this project.
POSES = (
    "standing",
    "hands_on_hips",
    "elbows_lifted",
    "forearms_raised",
    "foot_lifted",
    "head_tilted",
    "arms_forward",
    "one_leg",
    "walking",
    "arms_raised",
)
#: Possible places of the registrations below the folder that the user names.
INSIDE = ("", "registrations", "training/registrations", "MPI-FAUST/training/registrations")


@dataclass(frozen=True)
class Faust(OneTemplate):
    """Source of FAUST's registrations.

    Parameters
    ----------
    root : path
        The folder with tr_reg_NNN.ply (.off, .obj), or a folder above it up to the parent of MPI-FAUST.
        NNN is 10 x subject + pose.
    rest_pose : int
        FAUST's number of the rest pose.
    target_poses : sequence of int
        FAUST's numbers of the target poses, in order.
    unaligned : sequence of int
        Poses that are turned as a whole against the rest pose. They get `more_landmarks` as well.
    landmarks : mapping
        Vertex of each landmark; see conf/defaust/source/faust.yaml.
    base_landmarks, more_landmarks : sequence of str
        Landmarks with handles in every pose, and additional landmarks of unaligned poses.

    Raises
    ------
    InputError
        When the folder holds no registrations, or a pose or landmark does not exist.
    """

    root: str
    rest_pose: int
    target_poses: tuple[int, ...]
    unaligned: tuple[int, ...]
    landmarks: Mapping[str, int]
    base_landmarks: tuple[str, ...]
    more_landmarks: tuple[str, ...]

    name = "faust"
    #: All of FAUST's subjects, even if files are missing.
    subjects = tuple(range(10))

    def __post_init__(self) -> None:
        landmarks = require_landmarks(self.landmarks)
        for name, vertex in landmarks.items():
            if vertex >= VERTICES:
                raise InputError(
                    f"source.landmarks: the vertex of {name} is {vertex}, "
                    f"but the registrations have {VERTICES} vertices"
                )
        object.__setattr__(self, "landmarks", landmarks)
        check_choice(self, "base_landmarks", known=landmarks)
        check_choice(self, "more_landmarks", known=landmarks, empty=True)
        both = "source.base_landmarks and source.more_landmarks"
        require_choice(self.landmark_names, known=landmarks, option=both)
        known = range(len(POSES))
        check_choice(self, "target_poses", known=known)
        check_choice(self, "unaligned", known=known, empty=True)
        require_choice([self.rest_pose], known=known, option="source.rest_pose")
        if self.rest_pose in self.target_poses:
            raise InputError(f"source.target_poses holds {self.rest_pose}, which is the rest pose")
        self._files  # noqa: B018  # report a wrong folder here, not in a worker

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the dataset card."""
        texts = provenance_texts("faust")
        poses = ", ".join(map(str, self.target_poses))
        return {
            **texts,
            "limits": [limit.format(poses=poses) for limit in texts["limits"]],
            "note": texts["note"].format(poses=poses, rest_pose=self.rest_pose),
            "rest_pose": self.rest_pose,
            "target_poses": list(self.target_poses),
            "landmark_vertices": self.landmark_vertices(0),
        }

    @property
    def files(self) -> Iterable[Path]:
        """All registrations in the folder."""
        return self._files.values()

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each existing file of the subjects, by file name."""
        numbers = [k for s in subjects for k in sorted(self._numbers(s)) if k in self._files]
        return {self._files[k].name: sha256(self._files[k]) for k in numbers}

    def landmark_vertices(self, subject: int) -> dict[str, int]:
        """The same vertices on every subject."""
        return {name: self.landmarks[name] for name in self.landmark_names}

    def _numbers(self, subject: int) -> list[int]:
        """Numbers of the registrations of a subject."""
        return [10 * subject + pose for pose in (self.rest_pose, *self.target_poses)]

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The target poses, named by FAUST's number and a word."""
        return self._poses(
            (f"{pose}_{POSES[pose]}", pose not in self.unaligned) for pose in self.target_poses
        )

    def rest(self, subject: int) -> Mesh:
        """Rest mesh."""
        return self._read(10 * subject + self.rest_pose)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Registered mesh in a target pose."""
        return self._read(10 * subject + int(pose.name.split("_", 1)[0]))

    def _read(self, number: int) -> Mesh:
        """Registration, checked: manifold, one component, with the faces of the first one."""
        if number not in self._files:
            complete = [s for s in self.subjects if self._files.keys() >= {*self._numbers(s)}]
            poses = shortened((self.rest_pose, *self.target_poses))
            raise InputError(
                f"tr_reg_{number:03d} is missing; the poses {poses} are complete for the subjects "
                f"[{','.join(map(str, complete))}]"
            )
        file = SourceShape(f"tr_reg_{number:03d}", self._files[number])
        V, F = file.arrays()
        first = min(self._files)
        with file.named():
            mesh = Mesh(V, F)
            mesh.require_manifold()
            mesh.require_one_component()
            if (mesh.n, mesh.m) != (VERTICES, FACES):
                raise InputError(
                    f"{mesh.n} vertices and {mesh.m} faces, but the registrations have {VERTICES} and {FACES}"
                )
            if number != first and not np.array_equal(mesh.F, self._faces):
                raise InputError(
                    f"its faces differ from the faces of {self._files[first].name}, but all registrations "
                    "share one list of faces; take the file from FAUST again"
                )
        return mesh

    @cached_property
    def _files(self) -> dict[int, Path]:
        """File of each registration by its number."""
        root = existing(self.root, option="source.root=MPI-FAUST")
        for folder in (root / inside for inside in INSIDE):
            files = mesh_files(folder, MESH_SUFFIXES) if folder.is_dir() else {}
            names = [name for name in sorted(files) if re.fullmatch(r"tr_reg_0\d\d", name)]
            if names:
                return {int(name[-3:]): files[name] for name in names}
        raise InputError(
            f"{root} holds no registrations (tr_reg_NNN.ply, .off or .obj); set source.root to the folder "
            "MPI-FAUST, or to the training/registrations inside it"
        )

    @cached_property
    def _faces(self) -> np.ndarray:
        """Faces of the first registration, which all registrations share."""
        return self._read(min(self._files)).F
