"""Meshes in vertex correspondence, read from the user's own files: TOSCA, animations, archives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from defaust.folder.layout import sha256
from defaust.schema import mismatch
from defaust.sources.choices import check_choice, require_choice, require_landmarks
from defaust.sources.files import LAYOUTS, Shape, existing, find_shapes
from defaust.sources.source import SourcePose
from defaust.sources.winding import same_triangles, wound_outward
from sshade import InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.sampling.fronts import Fronts, farthest_point_sampling

#: Facts that nobody but the user knows.
FACTS = ("title", "origin", "unit", "axes", "licence", "citation")


@dataclass(frozen=True)
class RegisteredSequence:
    """Source of registered sequences; a subject is a class of TOSCA's, or the one sequence.

    Meshes may have boundary loops; they must be manifold and of one component.
    Files of a class may list the same triangles in another order or winding:
    all meshes of the class get the rest pose's list, wound outward.

    Parameters
    ----------
    root : path
        A folder of .ply, .off, .obj, .vert with .tri, or .mat files, or an
        .npz file with positions V_0, V_1, ... and triangles F.
    layout : str
        ``auto``, ``tosca`` or ``sequence``; see :func:`defaust.sources.files.find_shapes`.
    classes : sequence of str, optional
        Use only these, in this order: they are the subjects 0, 1, ...; by default all.
    rest_pose : str, optional
        Name of the rest pose, where it is not the first of its class.
    poses_used : sequence of str, optional
        Names of the target poses; by default all but the rest pose.
    landmarks : int or mapping
        So many by farthest point sampling on the rest pose, or the vertex of
        each by name (one class only). All of them are used in every pose.
    name : str
        Short identifier of the dataset.
    facts : mapping
        ``title``, ``origin``, ``unit``, ``axes``, ``licence``, ``citation``.

    Raises
    ------
    InputError
        On a wrong folder, or names that are not there.
    """

    root: str
    facts: Mapping[str, str]
    layout: str = "auto"
    classes: tuple[str, ...] | None = None
    rest_pose: str | None = None
    poses_used: tuple[str, ...] | None = None
    landmarks: int | Mapping[str, int] = 8
    name: str = "sequence"
    _oriented: dict[int, Mesh] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", str(self.name)):
            raise InputError(f"source.name={self.name} is not made of letters, digits, - and _")
        if self.layout not in LAYOUTS:
            raise InputError(f"source.layout={self.layout} is unknown; use one of {', '.join(LAYOUTS)}")
        wrong = set(self.facts) ^ set(FACTS)
        if wrong:
            raise InputError(f"source.facts needs {', '.join(FACTS)}; look at {sorted(wrong)[0]!r}")
        if self.classes is not None:
            check_choice(self, "classes", known=self._found)
        names = [shape.name for of_class in self._shapes.values() for shape in of_class]
        if self.rest_pose is not None:
            require_choice([self.rest_pose], known=names, option="source.rest_pose")
        if self.poses_used is not None:
            check_choice(self, "poses_used", known=names)
        if not mismatch(self.landmarks, int):
            if self.landmarks < 1:
                raise InputError(f"source.landmarks is {self.landmarks}; it must be at least 1")
            return
        object.__setattr__(self, "landmarks", require_landmarks(self.landmarks, option="source.landmarks"))
        if len(self._shapes) > 1:
            raise InputError(
                f"source.landmarks gives vertices, but there are the classes {', '.join(self._shapes)}; "
                "choose one with source.classes=[...], or give a number for farthest point sampling"
            )

    @property
    def subjects(self) -> tuple[int, ...]:
        """One number a class."""
        return tuple(range(len(self._shapes)))

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Those given, or fps_0, fps_1, ... in order of sampling."""
        if isinstance(self.landmarks, int):
            return tuple(f"fps_{k}" for k in range(self.landmarks))
        return tuple(self.landmarks)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the card."""
        sampled = isinstance(self.landmarks, int)
        return {
            **{name: str(self.facts[name]) for name in FACTS},
            "limits": [
                "The meshes are as they were found, but for triangles: all poses of a subject have those of "
                "the rest pose, wound outward.",
                "Landmarks are sampled farthest from each other on the rest pose and have no meaning."
                if sampled
                else "Landmarks are vertices that the configuration names.",
                "Whether a pose is turned as a whole against the rest pose was not examined.",
            ],
            "classes": list(self._shapes),
            "rest_poses": [self._rest(subject).name for subject in self.subjects],
            "landmark_choice": self.landmarks if sampled else dict(self.landmarks),
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each file of these subjects, by the file's name."""
        found = {}
        for subject in subjects:
            for shape in (self._rest(subject), *self._targets(subject)):
                for path in shape.files:
                    if not path.is_file():
                        raise InputError(f"{path}: no such file")
                    if path.name not in found:
                        found[path.name] = sha256(path)
        return found

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Vertices as given, or sampled on the rest mesh, beginning at an end of it."""
        rest = self.rest(subject)
        if isinstance(self.landmarks, int):
            graph = vertex_graph(rest)
            # Farthest from any vertex is an end of the shape.
            end = Fronts(graph, np.array([0])).distance.argmax()
            samples = farthest_point_sampling(graph, self.landmarks, first=np.array([end])).samples
            return dict(zip(self.landmark_names, samples.tolist(), strict=True))
        for name, vertex in self.landmarks.items():
            if vertex >= rest.n:
                raise InputError(
                    f"the vertex of landmark {name} is {vertex}, but there are {rest.n} vertices"
                )
        return dict(self.landmarks)

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The other meshes of the class, in order."""
        return tuple(
            SourcePose(name=shape.name, landmarks=self.landmark_names, aligned=None)
            for shape in self._targets(subject)
        )

    def rest(self, subject: int) -> Mesh:
        """Rest mesh, wound outward; checked: manifold, one component."""
        if subject not in self._oriented:
            shape = self._rest(subject)
            with shape.named():
                mesh = wound_outward(shape.mesh())
                try:
                    mesh.require_manifold()
                    mesh.require_one_component()
                except InputError as error:
                    raise InputError(f"{error}; or leave its class out with source.classes") from error
            self._oriented[subject] = mesh
        return self._oriented[subject]

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """A mesh of the class, with the triangles of the rest mesh."""
        rest = self.rest(subject)
        shape = next(s for s in self._targets(subject) if s.name == pose.name)
        mesh = shape.mesh()
        first = self._rest(subject).name
        if mesh.n != rest.n:
            raise InputError(f"{shape.label}: {mesh.n} vertices, but the rest pose {first} has {rest.n}")
        if not same_triangles(mesh.F, rest.F):
            raise InputError(
                f"{shape.label}: other triangles than the rest pose {first}; "
                "the meshes of a sequence must be in correspondence"
            )
        return Mesh(mesh.V, rest.F)

    @cached_property
    def _found(self) -> dict[str, tuple[Shape, ...]]:
        root = existing(self.root, option="source.root to a folder of meshes, or an .npz file")
        return find_shapes(root, layout=self.layout)

    @property
    def _shapes(self) -> dict[str, tuple[Shape, ...]]:
        """The classes that are used: the subjects, in their order."""
        return {name: self._found[name] for name in self.classes or self._found}

    def _of(self, subject: int) -> tuple[str, tuple[Shape, ...]]:
        if subject not in self.subjects:
            raise InputError(f"there is no subject {subject}; they are 0 to {len(self._shapes) - 1}")
        return list(self._shapes.items())[subject]

    def _rest(self, subject: int) -> Shape:
        _, shapes = self._of(subject)
        return next((s for s in shapes if s.name == self.rest_pose), shapes[0])

    def _targets(self, subject: int) -> tuple[Shape, ...]:
        name, shapes = self._of(subject)
        rest = self._rest(subject)
        targets = tuple(
            s for s in shapes if s != rest and (self.poses_used is None or s.name in self.poses_used)
        )
        if not targets:
            raise InputError(
                f"the class {name} has no target pose besides its rest pose {rest.name}; "
                "leave it out with source.classes or subjects"
            )
        return targets
