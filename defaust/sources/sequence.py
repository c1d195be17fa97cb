"""Meshes in vertex correspondence, read from the user's own folder, such as TOSCA."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from defaust.folder.layout import sha256
from defaust.schema import mismatch
from defaust.sources.choices import check_choice, require_choice, require_landmarks, shortened
from defaust.sources.files import LAYOUTS, Classes, SourceShape, existing, find_shapes
from defaust.sources.source import Source, SourcePose, provenance_texts
from defaust.sources.winding import same_triangles, wound_outward
from sshade import InputError, Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.cutting import without_duplicates
from sshade.mesh.surface import cleaned
from sshade.proxy.fronts import Fronts, farthest_point_sampling

#: Facts for the dataset card that only the user knows.
FACTS = ("title", "origin", "unit", "axes", "licence", "citation")


class _Surface(NamedTuple):
    """The cleaned rest mesh of a class.

    Attributes
    ----------
    rest : Mesh
    F : (k, 3) int
        Faces of the file.
    vertex : (j,) int
        For each vertex of the file the vertex of `rest`, or -1.
    dropped : dict
        Counts of removed vertices and faces.
    """

    rest: Mesh
    F: np.ndarray
    vertex: np.ndarray
    dropped: dict[str, int]


@dataclass(frozen=True)
class _Class:
    """The meshes of a subject; `targets` are possible target poses."""

    name: str
    rest: SourceShape
    targets: tuple[SourceShape, ...]

    @cached_property
    def surface(self) -> _Surface:
        """The cleaned rest mesh."""
        V, F = self.rest.arrays()
        with self.rest.named():
            whole = cleaned(V, F)
            single = without_duplicates(whole.mesh)
            count = {
                "unused_vertices": whole.facts.unused,
                "faces_that_repeat_a_vertex": whole.facts.collapsed,
                "duplicate_faces": whole.mesh.m - single.m,
            }
            dropped = {name: number for name, number in count.items() if number}
            return _Surface(wound_outward(single), F, whole.vertex, dropped)


@dataclass(frozen=True)
class RegisteredSequence(Source):
    """Source of registered sequences; a subject is a class of files, or the only sequence.

    Meshes may have boundaries, edges of more than two faces, and several components. Vertices without a
    face, and faces that repeat a vertex or another face, are removed. Files of a class may list the same
    triangles in different order or orientation. All meshes of the class get the rest pose's list, oriented
    outward where possible.

    Parameters
    ----------
    root : path
        A folder of .ply, .off, .obj, .vert with .tri, or .mat files.
    facts : mapping
        ``title``, ``origin``, ``unit``, ``axes``, ``licence``, ``citation``.
    layout : str
        ``auto``, ``tosca`` or ``sequence``; see :func:`defaust.sources.files.find_shapes`.
    classes : sequence of str, optional
        Classes to use, in this order: subjects 0, 1, ... By default all classes that have a target pose,
        except the classes in `without`.
    without : sequence of str
        Classes to leave out if `classes` is not given. Unknown names are ignored.
    rest_pose : str, optional
        Name of the rest pose; by default a mesh named ``rest``, or else the first mesh of the class.
    poses_used : sequence of str, optional
        Names of the target poses, which keep the order of the files; by default all other meshes.
    landmarks : int or mapping
        Number of landmarks, sampled farthest from each other on the rest pose; or the vertex of each
        landmark by name, as the file counts vertices (for one class only). Every pose uses all of them.
    name : str
        Short identifier of the dataset.

    Raises
    ------
    InputError
        On a wrong folder, or unknown names.
    """

    root: str
    facts: Mapping[str, str]
    layout: str = "auto"
    classes: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    rest_pose: str | None = None
    poses_used: tuple[str, ...] | None = None
    landmarks: int | Mapping[str, int] = 8
    name: str = "sequence"

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", str(self.name)):
            raise InputError(f"source.name={self.name} is not made of letters, digits, - and _")
        if self.layout not in LAYOUTS:
            raise InputError(f"source.layout={self.layout} is unknown; use one of {', '.join(LAYOUTS)}")
        wrong = set(self.facts) ^ set(FACTS)
        if wrong:
            raise InputError(f"source.facts needs {', '.join(FACTS)}; look at {sorted(wrong)[0]!r}")
        without = self.without if isinstance(self.without, str) else list(self.without)
        if problem := mismatch(without, [str], "source.without"):
            raise InputError(problem)
        if self.classes is not None:
            check_choice(self, "classes", known=self._found[0])
        names = [shape.name for one in self._subjects for shape in self._found[0][one.name]]
        if self.rest_pose is not None:
            require_choice([self.rest_pose], known=names, option="source.rest_pose")
        if self.poses_used is not None:
            check_choice(self, "poses_used", known=names)
        if type(self.landmarks) is int:
            if self.landmarks < 1:
                raise InputError(f"source.landmarks is {self.landmarks}; it must be at least 1")
            return
        object.__setattr__(self, "landmarks", require_landmarks(self.landmarks))
        if len(self.subjects) > 1:
            raise InputError(
                "source.landmarks gives vertices, but there are the classes "
                f"{', '.join(one.name for one in self._subjects)}; choose one with source.classes=[...], or "
                "give a number for farthest point sampling"
            )

    @property
    def subjects(self) -> tuple[int, ...]:
        """One number for each class."""
        return tuple(range(len(self._subjects)))

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """The configured names, or fps_0, fps_1, ... in order of sampling."""
        if isinstance(self.landmarks, int):
            return tuple(f"fps_{k}" for k in range(self.landmarks))
        return tuple(self.landmarks)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the dataset card."""
        texts = provenance_texts("sequence")
        sampled = isinstance(self.landmarks, int)
        names = [one.name for one in self._subjects]
        limits = [text.format(landmarks=texts["sampled" if sampled else "named"]) for text in texts["limits"]]
        without = [name for name in self.without if name in self._found[0] and name not in names]
        return {
            **{name: str(self.facts[name]) for name in FACTS},
            "limits": limits,
            "classes": names,
            "rest_poses": [one.rest.name for one in self._subjects],
            "landmark_choice": self.landmarks,
            **({"without": without} if without else {}),
            **({"left_out": self._unused} if self._unused else {}),
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each existing file of the subjects, by file name."""
        chosen = [self._subjects[s] for s in subjects]
        shapes = [shape for one in chosen for shape in (one.rest, *one.targets)]
        paths = {path.name: path for shape in shapes for path in shape.files if path.is_file()}
        return {name: sha256(path) for name, path in paths.items()}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Configured vertices, or samples of the rest mesh that begin at an end of its largest component."""
        surface = self._subjects[subject].surface
        rest, stored = surface.rest, surface.vertex
        if isinstance(self.landmarks, int):
            if rest.topology.components > self.landmarks:
                raise InputError(
                    f"the rest mesh has {rest.topology.components} components, and each needs a landmark; "
                    f"set source.landmarks to {rest.topology.components} or more"
                )
            graph = vertex_graph(rest)
            largest = rest.component == np.bincount(rest.component).argmax()
            # The vertex farthest from any vertex is an end of the shape.
            distance = Fronts(graph, np.flatnonzero(largest)[:1]).distance
            end = np.where(largest, distance, -1.0).argmax()
            samples = farthest_point_sampling(graph, self.landmarks, first=np.array([end])).samples
            return dict(zip(self.landmark_names, samples.tolist(), strict=True))
        for name, vertex in self.landmarks.items():
            if vertex >= len(stored):
                raise InputError(
                    f"the vertex of landmark {name} is {vertex}, but there are {len(stored)} vertices"
                )
            if stored[vertex] < 0:
                raise InputError(f"the vertex of landmark {name}, {vertex}, belongs to no face")
        return {name: int(stored[vertex]) for name, vertex in self.landmarks.items()}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The target poses, in order."""
        one = self._subjects[subject]
        if not one.targets:
            raise InputError(
                f"the class {one.name} has no target pose besides its rest pose {one.rest.name}; "
                "leave it out with source.classes or subjects"
            )
        return tuple(SourcePose(shape.name, self.landmark_names, aligned=None) for shape in one.targets)

    def rest(self, subject: int) -> Mesh:
        """Rest mesh, oriented outward where possible."""
        return self._subjects[subject].surface.rest

    def dropped(self, subject: int) -> Mapping[str, int]:
        """Counts of vertices and faces in the rest mesh's file that are not part of its surface."""
        return self._subjects[subject].surface.dropped

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """A mesh of the class, with the triangles of the rest mesh."""
        one = self._subjects[subject]
        rest, surface = one.rest, one.surface
        shape = next(s for s in one.targets if s.name == pose.name)
        V, F = shape.arrays()
        n = len(surface.vertex)
        with shape.named():
            if len(V) != n:
                raise InputError(f"{len(V)} vertices, but the rest pose {rest.name} has {n}")
            if not same_triangles(F, surface.F):
                raise InputError(
                    f"other triangles than the rest pose {rest.name}; the meshes of a sequence must be in "
                    "correspondence"
                )
            return Mesh(V[surface.vertex >= 0], surface.rest.F)

    @cached_property
    def _found(self) -> tuple[Classes, dict[str, str]]:
        root = existing(self.root, option="source.root to a folder of meshes")
        return find_shapes(root, layout=self.layout)

    @cached_property
    def _subjects(self) -> list[_Class]:
        """The classes in use."""
        found = self._found[0]
        if self.classes is not None:
            return [self._class(name) for name in self.classes]
        classes = [self._class(name) for name in found if name not in self.without]
        if not classes:
            raise InputError(f"source.without leaves no class of {shortened(list(found))}")
        return [one for one in classes if one.targets] or classes

    @property
    def _unused(self) -> dict[str, str]:
        """Names of unused classes and files, and the reasons."""
        found, files = self._found
        used = {one.name for one in self._subjects} if self.classes is None else set(found)
        single = [name for name in found if name not in used and name not in self.without]
        return files | dict.fromkeys(single, "it has no target pose besides its rest pose")

    def _class(self, name: str) -> _Class:
        shapes, used = self._found[0][name], self.poses_used
        rest = next((s for s in shapes if s.name == self.rest_pose), shapes[0])
        targets = tuple(s for s in shapes if s != rest and (used is None or s.name in used))
        return _Class(name, rest, targets)
