"""Sequences of generated bodies and animals, with the ground truth of every pose.

A motion takes a body from rest into a pose by growing rotations of its bones. A retargeting drives an animal
or a body by another one. The ground truth is the target with the same rotations of its bones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from defaust.sources.animals import arrays_of, load_animal
from defaust.sources.choices import require_choice
from defaust.sources.synthetic import Bodies, SyntheticBodies, load_bodies
from defaust.tasks.loop import split
from sshade import DeformationTask, Handles, Mesh

#: Number of handles near each landmark, as in the datasets.
NEAR = 30
#: Number of marks on bodies.
MARKS = 60
#: Names of bones of a species that correspond to a bone of other species, without sides.
SAME_BONE = {
    "forepaw": "forefoot",
    "cannon": "forefoot",
    "foot": "hindfoot",
    "pastern": "hindfoot",
    "neck_1": "neck",
    "spine_1": "spine",
}
#: Least number of vertices that a bone with marks moves most, and directions of its marks.
LEAST = 20
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
#: Pairs of bodies or species: the first drives the second.
PAIRS: tuple[tuple[str | int, str | int], ...] = (
    (0, 4),
    (3, 7),
    ("cat", "elephant"),
    ("cat", "lizard"),
    ("horse", "cat"),
    ("elephant", "horse"),
)


class Motion(NamedTuple):
    """A sequence of poses of one mesh.

    Attributes
    ----------
    task : DeformationTask
        Mesh at rest, and its handles.
    truth : (k, n, 3) float64
        True vertices of each pose.
    """

    task: DeformationTask
    truth: np.ndarray

    @property
    def targets(self) -> np.ndarray:
        """(k, h, 3) float64: targets of the handles in each pose."""
        return self.truth[:, self.task.handles.index]


class Drive(NamedTuple):
    """A mesh in several poses that drives another mesh.

    Attributes
    ----------
    name : str
    source, target : Mesh
        At rest.
    pose_names : tuple of str
    poses : (k, n, 3) float64
        Vertices of the source.
    marks : (m, 2) int64
        Vertices of the source and of the target that correspond.
    truth : (k, t, 3) float64
        True vertices of the target, up to a translation.
    """

    name: str
    source: Mesh
    target: Mesh
    pose_names: tuple[str, ...]
    poses: np.ndarray
    marks: np.ndarray
    truth: np.ndarray


def body_motion(*, pose: str, count: int, level: int = 0) -> Motion:
    """Make a motion of a synthetic body from rest into a pose, slow at both ends.

    Parameters
    ----------
    pose : str
    count : int
        Number of poses, at least two; the first is the rest pose.
    level : int
        How often each triangle is divided into four. The body has 6890, 27,554 or 110,210 vertices.

    Raises
    ------
    InputError
        On an unknown pose.
    """
    bodies, source = load_bodies(), SyntheticBodies()
    require_choice((pose,), known=bodies.pose_names, option="pose")
    k = bodies.pose_names.index(pose)
    time = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, count))
    rotations, shift = bodies.rotations[0, k], bodies.shifts[0, k]
    posed = [bodies.pose(0, rotations=s * rotations, shift=s * shift) for s in time]
    F, truth = bodies.faces, np.array(posed)
    for _ in range(level):
        F, truth = divided(F, truth)
    mesh = Mesh(truth[0], F)
    places = {name: source.landmarks[name] for name in source.base_landmarks}
    index, group = [], []
    for number, vertex in enumerate(places.values()):
        near = np.argsort(np.linalg.norm(bodies.rest[0] - bodies.rest[0][vertex], axis=1))[:NEAR]
        index.append(near)
        group.append(np.full(NEAR, number))
    vertex, first = np.unique(np.concatenate(index), return_index=True)
    handles = Handles(vertex, mesh.V[vertex], group=np.concatenate(group)[first])
    return Motion(DeformationTask(pose, mesh, handles), truth)


def divided(F: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Divide each triangle of F (m, 3) into four, in all shapes (k, n, 3), at the midpoints of edges."""
    mesh = Mesh(shapes[0], F)
    return split(mesh).F, np.concatenate([shapes, shapes[:, mesh.edges].mean(axis=2)], axis=1)


def drives(names: tuple[tuple[str | int, str | int], ...] = PAIRS) -> list[Drive]:
    """Make the retargetings of some pairs of :data:`PAIRS`."""
    return [_bodies(a, b) if isinstance(a, int) and isinstance(b, int) else _animals(a, b) for a, b in names]


def _bodies(first: int, second: int) -> Drive:
    """Drive a body by another one, with the first four poses."""
    bodies, names = load_bodies(), load_bodies().pose_names[:4]

    def posed(subject: int) -> np.ndarray:
        rotations, shifts = bodies.rotations[first], bodies.shifts[first]
        return np.array([bodies.pose(subject, rotations=rotations[k], shift=shifts[k]) for k in range(4)])

    marks = spread(bodies.rest[first], MARKS)
    pairs = np.stack([marks, marks], axis=1)
    source = Mesh(bodies.rest[first], bodies.faces)
    poses, rest = posed(first), bodies.rest[second]
    return _drive(f"body {first} to {second}", source, names, poses, pairs, bodies.faces, rest, posed(second))


def _animals(first: str | int, second: str | int) -> Drive:
    """Drive an animal by another one; bones without a partner rest relative to their parents."""
    a, b = load_animal(str(first)), load_animal(str(second))
    mine, others = _bones(str(first)), _bones(str(second))
    common = [name for name in mine if name in others]
    poses = np.array(
        [a.pose(0, rotations=r, shift=s) for r, s in zip(a.rotations[0], a.shifts[0], strict=True)]
    )
    truth = []
    for rotations in a.rotations[0]:
        turned = np.zeros((len(b.parents), 3))
        for name in common:
            turned[others[name]] = rotations[mine[name]]
        truth.append(b.pose(0, rotations=turned, shift=np.zeros(3)))
    marked = [
        name
        for name in common
        if min(len(_moved_by(a, mine[name])), len(_moved_by(b, others[name]))) >= LEAST
    ]
    pairs = np.array(
        [
            [_extreme(animal, bones[name], d) for animal, bones in ((a, mine), (b, others))]
            for name in marked
            for d in DIRECTIONS
        ]
    )
    for side in (0, 1):
        pairs = pairs[np.sort(np.unique(pairs[:, side], return_index=True)[1])]
    source = Mesh(a.rest[0], a.faces)
    title = f"{first} to {second}"
    return _drive(title, source, a.pose_names, poses, pairs, b.faces, b.rest[0], np.array(truth))


def _drive(
    name: str,
    source: Mesh,
    pose_names: tuple[str, ...],
    poses: np.ndarray,
    marks: np.ndarray,
    F: np.ndarray,
    rest: np.ndarray,
    truth: np.ndarray,
) -> Drive:
    """Return a retargeting whose target has four times as many triangles as the animal or body."""
    finer, shapes = divided(F, np.concatenate([rest[None], truth]))
    return Drive(name, source, Mesh(shapes[0], finer), pose_names, poses, marks, shapes[1:])


def _bones(species: str) -> dict[str, int]:
    """Return the numbers of bones by names that all species share."""
    found: dict[str, int] = {}
    for number, bone in enumerate(arrays_of(species)["bones"].tolist()):
        side = bone[-2:] if bone.endswith(("_l", "_r")) else ""
        plain = bone.removesuffix(side)
        found.setdefault(SAME_BONE.get(plain, plain) + side, number)
    return found


def _moved_by(animal: Bodies, bone: int) -> np.ndarray:
    """Return the vertices that a bone moves most."""
    strongest = animal.bone[np.arange(len(animal.bone)), animal.weight.argmax(axis=1)]
    return np.flatnonzero(strongest == bone)


def _extreme(animal: Bodies, bone: int, direction: np.ndarray) -> int:
    """Return the vertex of a bone that is farthest in a direction."""
    vertices = _moved_by(animal, bone)
    return int(vertices[(animal.rest[0][vertices] @ direction).argmax()])


def spread(V: np.ndarray, count: int) -> np.ndarray:
    """Return vertices of V (n, 3) that are far from each other."""
    found, distance = [0], np.linalg.norm(V - V[0], axis=1)
    while len(found) < count:
        found.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(V - V[found[-1]], axis=1))
    return np.array(found)
