"""The registrations of FAUST, read from the user's own copy.

The hundred meshes of MPI-FAUST/training/registrations: ten subjects in ten
poses, 6890 vertices and 13776 faces, one face array for all. Nothing of them
is part of this package.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from defaust.folder.layout import sha256
from defaust.sources.registered import (
    MESH_SUFFIXES,
    as_landmarks,
    existing_folder,
    is_whole,
    read_counted,
    refuse_repeated,
    require_whole,
    shortened,
)
from defaust.sources.source import SourcePose
from sshade import InputError, Mesh

SUBJECTS = 10
VERTICES, FACES = 6890, 13776
#: What the poses show, by FAUST's number; the words are this project's.
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
#: Where the registrations lie below the folder that the user names.
INSIDE = ("", "registrations", "training/registrations", "MPI-FAUST/training/registrations")


@dataclass(frozen=True)
class Faust:
    """Source of FAUST's registrations.

    Parameters
    ----------
    root : path
        The folder with tr_reg_NNN.ply (.off, .obj), or one of those around it,
        MPI-FAUST included; NNN is 10 x subject + pose.
    rest_pose : int
        FAUST's number of the rest pose.
    target_poses : sequence of int
        FAUST's numbers of the target poses, in order.
    unaligned : sequence of int
        Poses turned as a whole against the rest pose: they get more landmarks.
    landmarks : mapping
        Vertex of each landmark; conf/defaust/source/faust.yaml has a table.
    base_landmarks, more_landmarks : sequence of str
        Landmarks with handles in every pose, and those of unaligned poses besides.

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
    name: str = field(default="faust", init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "landmarks", as_landmarks(self.landmarks, option="source.landmarks"))
        for name, vertex in self.landmarks.items():
            if vertex >= VERTICES:
                raise InputError(
                    f"source.landmarks: the vertex of {name} is {vertex}, "
                    f"but the registrations have {VERTICES} vertices"
                )
        for attribute, known in (
            ("base_landmarks", self.landmarks),
            ("more_landmarks", self.landmarks),
            ("target_poses", range(len(POSES))),
            ("unaligned", range(len(POSES))),
        ):
            _check_list(getattr(self, attribute), known=known, option=f"source.{attribute}")
            object.__setattr__(self, attribute, tuple(getattr(self, attribute)))
        refuse_repeated(self.landmark_names, option="source.base_landmarks and source.more_landmarks")
        refuse_repeated(self.target_poses, option="source.target_poses")
        if not is_whole(self.rest_pose) or self.rest_pose not in range(len(POSES)):
            raise InputError(f"source.rest_pose is {self.rest_pose!r}; FAUST's poses are 0 to 9")
        if not self.target_poses or not self.base_landmarks:
            raise InputError("source.target_poses and source.base_landmarks need one entry at least")
        if self.rest_pose in self.target_poses:
            raise InputError(f"source.target_poses holds {self.rest_pose}, which is the rest pose")
        self._files  # noqa: B018  # a wrong folder is an error now, not in a worker

    @property
    def subjects(self) -> tuple[int, ...]:
        """0 to 9, whether or not their files are there."""
        return tuple(range(SUBJECTS))

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Base landmarks, then the others."""
        return (*self.base_landmarks, *self.more_landmarks)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the card."""
        poses = ", ".join(str(pose) for pose in self.target_poses)
        return {
            "title": "registrations of FAUST",
            "origin": "MPI-FAUST, training/registrations: ten persons in ten poses, the meshes of one "
            "template (6890 vertices, 13776 faces) registered to scans; read from the user's own copy",
            "licence": "The shapes are the user's own copy of FAUST, under FAUST's terms: research use, and "
            "nothing of it may be redistributed. Meshes and handle positions in this folder are made from "
            "them, so this folder may not be passed on either",
            "citation": 'F. Bogo, J. Romero, M. Loper, M. J. Black, "FAUST: dataset and evaluation for 3D '
            'mesh registration", CVPR 2014',
            "limits": [
                f"The target poses {poses} are a guess: the paper shows four in a figure and names none.",
                "The landmarks are vertices of FAUST's template, chosen by this project on renderings.",
                "The registrations are fitted to scans; where they intersect themselves, they are left so.",
            ],
            "axes": "y up, facing +z in most poses",
            "unit": "metre",
            "note": f"FAUST's poses {poses}, the rest pose {self.rest_pose} and the landmarks are a choice "
            "made here; the paper names none",
            "rest_pose": self.rest_pose,
            "target_poses": list(self.target_poses),
            "landmark_vertices": {name: self.landmarks[name] for name in self.landmark_names},
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each file of these subjects, by the file's name.

        Raises
        ------
        InputError
            When files are missing, with their names.
        """
        poses = (self.rest_pose, *self.target_poses)
        numbers = {s: [10 * s + pose for pose in poses] for s in subjects}
        missing = [f"tr_reg_{k:03d}" for of in numbers.values() for k in of if k not in self._files]
        if missing:
            complete = [s for s, of in numbers.items() if all(k in self._files for k in of)]
            hint = f"; those of subjects=[{','.join(map(str, complete))}] are there" if complete else ""
            raise InputError(
                f"{self._folder} lacks {shortened(missing)}: subjects {_join(subjects)} in poses "
                f"{_join(poses)} are {len(numbers) * len(poses)} files{hint}"
            )
        paths = [self._files[k] for of in numbers.values() for k in sorted(of)]
        return {path.name: sha256(path) for path in paths}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """The same vertices on every subject."""
        self._check(subject)
        return {name: self.landmarks[name] for name in self.landmark_names}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The target poses, named by FAUST's number and what they show."""
        self._check(subject)
        return tuple(
            SourcePose(
                name=f"{pose}_{POSES[pose]}",
                landmarks=self.landmark_names if pose in self.unaligned else self.base_landmarks,
                aligned=pose not in self.unaligned,
            )
            for pose in self.target_poses
        )

    def rest(self, subject: int) -> Mesh:
        """Rest mesh, checked: closed, manifold, one component."""
        mesh, path = self._read(subject, self.rest_pose)
        require_whole(mesh, label=str(path), closed=True)
        return mesh

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Registered mesh in a target pose."""
        return self._read(subject, int(pose.name.split("_", 1)[0]))[0]

    def _read(self, subject: int, pose: int) -> tuple[Mesh, Path]:
        self._check(subject)
        number = 10 * subject + pose
        if number not in self._files:
            raise InputError(f"{self._folder} lacks tr_reg_{number:03d}")
        path = self._files[number]
        mesh = read_counted(path, vertices=VERTICES, faces=FACES)
        if not np.array_equal(mesh.F, self._faces):
            raise InputError(
                f"{path}: its faces are not those of {self._first.name}, but all registrations share one "
                "list of faces; take the file from FAUST again"
            )
        return mesh, path

    @cached_property
    def _folder(self) -> Path:
        root = existing_folder(self.root, option="source.root=MPI-FAUST")
        if root.is_file():
            raise InputError(f"{root} is a file; give a folder")
        for inside in INSIDE:
            if (root / inside).is_dir() and _registrations(root / inside):
                return root / inside
        raise InputError(
            f"{root} holds no registrations (tr_reg_NNN.ply, .off or .obj); set source.root to the folder "
            "MPI-FAUST, or to the training/registrations inside it"
        )

    @cached_property
    def _files(self) -> dict[int, Path]:
        return _registrations(self._folder)

    @property
    def _first(self) -> Path:
        return self._files[min(self._files)]

    @cached_property
    def _faces(self) -> np.ndarray:
        """Faces of the first registration, which all others must have."""
        return read_counted(self._first, vertices=VERTICES, faces=FACES).F

    def _check(self, subject: int) -> None:
        if subject not in self.subjects:
            raise InputError(f"there is no FAUST subject {subject}; they are 0 to {SUBJECTS - 1}")


def _registrations(folder: Path) -> dict[int, Path]:
    """File of each registration; of several formats the first of MESH_SUFFIXES."""
    found: dict[int, Path] = {}
    for path in sorted(folder.iterdir(), reverse=True):
        match = re.fullmatch(r"tr_reg_(0\d\d)", path.stem)
        if match and path.suffix.lower() in MESH_SUFFIXES and path.is_file():
            number = int(match[1])
            rank = MESH_SUFFIXES.index(path.suffix.lower())
            if number not in found or rank < MESH_SUFFIXES.index(found[number].suffix.lower()):
                found[number] = path
    return found


def _check_list(value: Any, *, known: Any, option: str) -> None:
    if not isinstance(value, (list, tuple)):
        raise InputError(f"{option}={value} is not a list")
    for item in value:
        if isinstance(item, bool) or item not in known:
            raise InputError(f"{option}: {item!r} does not exist; choose from {_join(known)}")


def _join(items: Any) -> str:
    return ", ".join(str(item) for item in items)
