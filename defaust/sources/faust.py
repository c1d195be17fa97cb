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
from defaust.sources.choices import OneTemplate, check_choice, require_choice, require_landmarks, shortened
from defaust.sources.files import MESH_SUFFIXES, Shape, existing, mesh_files
from defaust.sources.source import SourcePose
from sshade import InputError, Mesh

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
class Faust(OneTemplate):
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

    #: Whether or not their files are there.
    subjects = tuple(range(10))

    def __post_init__(self) -> None:
        landmarks = require_landmarks(self.landmarks, option="source.landmarks")
        for name, vertex in landmarks.items():
            if vertex >= VERTICES:
                raise InputError(
                    f"source.landmarks: the vertex of {name} is {vertex}, "
                    f"but the registrations have {VERTICES} vertices"
                )
        object.__setattr__(self, "landmarks", landmarks)
        self._check_landmarks()
        known = range(len(POSES))
        check_choice(self, "target_poses", known=known)
        check_choice(self, "unaligned", known=known, empty=True)
        require_choice([self.rest_pose], known=known, option="source.rest_pose")
        if self.rest_pose in self.target_poses:
            raise InputError(f"source.target_poses holds {self.rest_pose}, which is the rest pose")
        self._files  # noqa: B018  # a wrong folder is an error now, not in a worker

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
            listed, of_each = (", ".join(map(str, numbers)) for numbers in (subjects, poses))
            raise InputError(
                f"{self._folder} lacks {shortened(missing)}: subjects {listed} in poses {of_each} are "
                f"{len(subjects) * len(poses)} files{hint}"
            )
        paths = [self._files[k] for of in numbers.values() for k in sorted(of)]
        return {path.name: sha256(path) for path in paths}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The target poses, named by FAUST's number and what they show."""
        return self._poses(
            subject, ((f"{pose}_{POSES[pose]}", pose not in self.unaligned) for pose in self.target_poses)
        )

    def rest(self, subject: int) -> Mesh:
        """Rest mesh, checked: closed, manifold, one component."""
        return self._read(subject, self.rest_pose, whole=True)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """Registered mesh in a target pose."""
        return self._read(subject, int(pose.name.split("_", 1)[0]))

    def _read(self, subject: int, pose: int, *, whole: bool = False) -> Mesh:
        self._require(subject)
        number = 10 * subject + pose
        if number not in self._files:
            raise InputError(f"{self._folder} lacks tr_reg_{number:03d}")
        file = Shape(f"tr_reg_{number:03d}", self._files[number])
        mesh = file.mesh(whole=whole)
        first = min(self._files)
        with file.named():
            if (mesh.n, mesh.m) != (VERTICES, FACES):
                raise InputError(
                    f"{mesh.n} vertices and {mesh.m} faces, but the registrations have {VERTICES} and {FACES}"
                )
            if whole and not mesh.is_closed:
                raise InputError(f"{len(mesh.boundary_edges)} boundary edges; it must be closed")
            if number != first and not np.array_equal(mesh.F, self._faces):
                raise InputError(
                    f"its faces are not those of {self._files[first].name}, but all registrations share one "
                    "list of faces; take the file from FAUST again"
                )
        return mesh

    @cached_property
    def _folder(self) -> Path:
        root = existing(self.root, option="source.root=MPI-FAUST")
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

    @cached_property
    def _faces(self) -> np.ndarray:
        """Faces of the first registration, which all others must have."""
        return self._read(*divmod(min(self._files), 10)).F


def _registrations(folder: Path) -> dict[int, Path]:
    """File of each registration by its number."""
    files = mesh_files(folder, MESH_SUFFIXES)
    return {int(name[-3:]): files[name] for name in sorted(files) if re.fullmatch(r"tr_reg_0\d\d", name)}
