"""Meshes in vertex correspondence, read from the user's own files: TOSCA, animations, archives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from defaust.folder.layout import sha256
from defaust.schema import mismatch
from defaust.sources.animations import far_frames
from defaust.sources.choices import check_choice, require_choice, require_landmarks, shortened
from defaust.sources.files import LAYOUTS, Shape, existing, find_shapes
from defaust.sources.source import SourcePose
from defaust.sources.winding import same_triangles, wound_outward
from sshade import InputError, Mesh
from sshade.mesh.adjacency import edge_graph
from sshade.mesh.surface import cleaned, without_duplicates
from sshade.sampling.fronts import Fronts, farthest_point_sampling

#: Facts that nobody but the user knows.
FACTS = ("title", "origin", "unit", "axes", "licence", "citation")

#: Of target poses that were chosen, for the card.
_FRAMES = (
    "Target poses of an animation are at most {} of its frames, each the farthest from those before it and "
    "from the rest pose, after the best rigid motion."
)


class _Surface(NamedTuple):
    """The rest mesh of a class, and what its file holds.

    `F` are the file's faces, `vertex` (n,) is the vertex of `rest` of each of the file's vertices, or -1.
    """

    rest: Mesh
    F: np.ndarray
    vertex: np.ndarray
    dropped: dict[str, int]


@dataclass(frozen=True)
class RegisteredSequence:
    """Source of registered sequences; a subject is a class of TOSCA's, or the one sequence.

    Meshes may have boundary loops, edges of more than two faces, and several components. Vertices
    that no face uses, and faces that repeat a vertex or another face, are no part of the surface
    and are not taken over.
    Files of a class may list the same triangles in another order or winding:
    all meshes of the class get the rest pose's list, wound outward where it can be.

    Parameters
    ----------
    root : path
        A folder of .ply, .off, .obj, .vert with .tri, or .mat files, an
        .npz file with positions V_0, V_1, ... and triangles F, or .anime files, each of them a class.
    layout : str
        ``auto``, ``tosca`` or ``sequence``; see :func:`defaust.sources.files.find_shapes`.
    classes : sequence of str, optional
        Use only these, in this order: they are the subjects 0, 1, ...; by default all that
        have a target pose, but for those `without`.
    without : sequence of str
        Classes that are not taken unless `classes` names them; they need not be there.
    rest_pose : str, optional
        Name of the rest pose, where it is not the first of its class.
    poses_used : sequence of str, optional
        Names of the target poses; by default all but the rest pose, of an animation `frames`.
    frames : int
        Of an animation so many target poses, each the frame that is farthest from those before it and
        from the rest pose; see :func:`defaust.sources.animations.far_frames`.
    landmarks : int or mapping
        So many by farthest point sampling on the rest pose, or the vertex of
        each by name, as its file counts (one class only). All of them are used in every pose.
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
    without: tuple[str, ...] = ()
    rest_pose: str | None = None
    poses_used: tuple[str, ...] | None = None
    frames: int = 4
    landmarks: int | Mapping[str, int] = 8
    name: str = "sequence"
    _surfaces: dict[int, _Surface] = field(default_factory=dict, init=False, repr=False, compare=False)
    _chosen: dict[str, tuple[Shape, ...]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", str(self.name)):
            raise InputError(f"source.name={self.name} is not made of letters, digits, - and _")
        if self.layout not in LAYOUTS:
            raise InputError(f"source.layout={self.layout} is unknown; use one of {', '.join(LAYOUTS)}")
        wrong = set(self.facts) ^ set(FACTS)
        if wrong:
            raise InputError(f"source.facts needs {', '.join(FACTS)}; look at {sorted(wrong)[0]!r}")
        problem = mismatch(list(self.without), [str], "source.without")
        problem = problem or mismatch(self.frames, int, "source.frames")
        if problem:
            raise InputError(problem)
        if self.frames < 1:
            raise InputError(f"source.frames is {self.frames}; it must be at least 1")
        if self.classes is not None:
            check_choice(self, "classes", known=self._found[0])
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
        without = [name for name in self.without if name in self._found[0] and name not in self._shapes]
        return {
            **{name: str(self.facts[name]) for name in FACTS},
            "limits": [
                "The meshes are as they were found, but for triangles: all poses of a subject have those of "
                "the rest pose, wound outward; and without vertices that no face uses and faces that "
                "repeat a vertex or another face.",
                "Landmarks are sampled farthest from each other on the rest pose and have no meaning."
                if sampled
                else "Landmarks are vertices that the configuration names.",
                "Whether a pose is turned as a whole against the rest pose was not examined.",
                *([_FRAMES.format(self.frames)] if self.poses_used is None and self._animated else []),
            ],
            "classes": list(self._shapes),
            "rest_poses": [self._rest(subject).name for subject in self.subjects],
            "landmark_choice": self.landmarks if sampled else dict(self.landmarks),
            **({"without": without} if without else {}),
            **({"left_out": self._usable[1]} if self._usable[1] else {}),
        }

    def checksums(self, subjects: Sequence[int]) -> Mapping[str, str]:
        """sha256 of each file of these subjects that is there, by the file's name."""
        shapes = [shape for s in subjects for shape in (self._rest(s), *self._targets_among(self._of(s)[1]))]
        paths = {path.name: path for shape in shapes for path in shape.files if path.is_file()}
        return {name: sha256(path) for name, path in paths.items()}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        """Vertices as given, or sampled on the rest mesh, beginning at an end of its largest component."""
        surface = self._surface(subject)
        rest, stored = surface.rest, surface.vertex
        if isinstance(self.landmarks, int):
            if rest.topology.components > self.landmarks:
                raise InputError(
                    f"the rest mesh has {rest.topology.components} components, and each needs a landmark; "
                    f"set source.landmarks to {rest.topology.components} or more"
                )
            graph = edge_graph(rest)
            largest = rest.component == np.bincount(rest.component).argmax()
            # Farthest from any vertex is an end of the shape.
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
        """The other meshes of the class, in order."""
        return tuple(
            SourcePose(name=shape.name, landmarks=self.landmark_names, aligned=None)
            for shape in self._targets(subject)
        )

    def rest(self, subject: int) -> Mesh:
        """Rest mesh, wound outward where it can be."""
        return self._surface(subject).rest

    def dropped(self, subject: int) -> Mapping[str, int]:
        """Numbers of vertices and faces of the rest mesh's file that are no part of its surface."""
        return self._surface(subject).dropped

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        """A mesh of the class, with the triangles of the rest mesh."""
        surface = self._surface(subject)
        shape = next(s for s in self._targets(subject) if s.name == pose.name)
        V, F = shape.arrays()
        first, n = self._rest(subject).name, len(surface.vertex)
        with shape.named():
            if len(V) != n:
                raise InputError(f"{len(V)} vertices, but the rest pose {first} has {n}")
            if not same_triangles(F, surface.F):
                raise InputError(
                    f"other triangles than the rest pose {first}; the meshes of a sequence must be in "
                    "correspondence"
                )
            return Mesh(V[surface.vertex >= 0], surface.rest.F)

    def _surface(self, subject: int) -> _Surface:
        if subject not in self._surfaces:
            shape = self._rest(subject)
            V, F = shape.arrays()
            with shape.named():
                whole = cleaned(V, F)
                single = without_duplicates(whole.mesh)
                count = {
                    "unused_vertices": whole.facts["unused"],
                    "faces_that_repeat_a_vertex": whole.facts["collapsed"],
                    "duplicate_faces": whole.mesh.m - single.m,
                }
                dropped = {name: number for name, number in count.items() if number}
                self._surfaces[subject] = _Surface(wound_outward(single), F, whole.vertex, dropped)
        return self._surfaces[subject]

    @cached_property
    def _found(self) -> tuple[dict[str, tuple[Shape, ...]], dict[str, str]]:
        root = existing(self.root, option="source.root to a folder of meshes, or an .npz file")
        return find_shapes(root, layout=self.layout)

    @property
    def _shapes(self) -> dict[str, tuple[Shape, ...]]:
        """The classes that are used: the subjects, in their order."""
        return self._usable[0]

    @cached_property
    def _usable(self) -> tuple[dict[str, tuple[Shape, ...]], dict[str, str]]:
        """The classes that are used, and why others, and files of no class, are not."""
        found, left_out = self._found
        left_out = dict(left_out)
        if self.classes is not None:
            return {name: found[name] for name in self.classes}, left_out
        usable = {name: shapes for name, shapes in found.items() if name not in self.without}
        single = [name for name, shapes in usable.items() if not self._targets_among(shapes)]
        if len(single) < len(usable):
            for name in single:
                del usable[name]
                left_out[name] = "it has no target pose besides its rest pose"
        if not usable:
            raise InputError(f"source.without leaves no class of {shortened(list(found))}")
        return usable, left_out

    def _of(self, subject: int) -> tuple[str, tuple[Shape, ...]]:
        if subject not in self.subjects:
            raise InputError(f"there is no subject {subject}; they are 0 to {len(self._shapes) - 1}")
        return list(self._shapes.items())[subject]

    def _rest(self, subject: int) -> Shape:
        return self._rest_among(self._of(subject)[1])

    def _targets(self, subject: int) -> tuple[Shape, ...]:
        name, shapes = self._of(subject)
        if name not in self._chosen:
            self._chosen[name] = self._far(subject, self._targets_among(shapes))
        targets = self._chosen[name]
        if not targets:
            raise InputError(
                f"the class {name} has no target pose besides its rest pose {self._rest(subject).name}; "
                "leave it out with source.classes or subjects"
            )
        return targets

    def _far(self, subject: int, targets: tuple[Shape, ...]) -> tuple[Shape, ...]:
        """Of the frames of an animation those that make the poses, where none are named."""
        rest = self._rest(subject)
        if rest.frame is None or self.poses_used is not None:
            return targets
        with rest.named():
            chosen = far_frames(rest.path, rest=rest.frame, count=self.frames)
        return tuple(shape for shape in targets if shape.frame in chosen)

    @property
    def _animated(self) -> bool:
        return any(shapes[0].frame is not None for shapes in self._shapes.values())

    def _rest_among(self, shapes: tuple[Shape, ...]) -> Shape:
        return next((s for s in shapes if s.name == self.rest_pose), shapes[0])

    def _targets_among(self, shapes: tuple[Shape, ...]) -> tuple[Shape, ...]:
        rest = self._rest_among(shapes)
        used = self.poses_used
        return tuple(s for s in shapes if s != rest and (used is None or s.name in used))
