"""Skeletons of animals, and smooth unions of capsules along their bones."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: Number of capsules between two nodes of a chain.
PIECES = 3
MIRROR = np.array([-1.0, 1.0, 1.0])


class Capsule(NamedTuple):
    """A tapered capsule with an elliptical section, around a segment of a bone.

    Attributes
    ----------
    bone : int
    ends : (2, 3) float64
        Ends of the axis.
    radius : (2,) float64
        Radius at each end.
    width : (2,) float64
        Extent of the section along `normal`, as a multiple of the radius.
    normal : (3,) float64
        Unit vector, perpendicular to the axis.
    """

    bone: int
    ends: np.ndarray
    radius: np.ndarray
    width: np.ndarray
    normal: np.ndarray


class Chain(NamedTuple):
    """Capsules along a smooth curve; `is_body` for trunk, neck and head, which are blended widely."""

    capsules: tuple[Capsule, ...]
    is_body: bool


class Rig(NamedTuple):
    """Bones and capsules of an animal.

    Attributes
    ----------
    bones : tuple of str
    parents : (b,) int64
        Parent of each bone, -1 at the root.
    joints : (b, 3) float64
        Joint that each bone turns about.
    limbs : (b,) int64
        Number of the limb of each bone, -1 for bones of the body.
    chains : tuple of Chain
    blend : (2,) float64
        Width of the blend within the body, and between limbs and body.
    """

    bones: tuple[str, ...]
    parents: np.ndarray
    joints: np.ndarray
    limbs: np.ndarray
    chains: tuple[Chain, ...]
    blend: np.ndarray

    def level(self, points: np.ndarray) -> np.ndarray:
        """Approximate distances (k,) of points (k, 3) to the surface, negative inside.

        The body is a smooth union. Limbs are added with a narrower blend, so that they do not fuse with
        each other. Nothing lies below the floor, y = 0.
        """
        found = [(_union(points, chain.capsules), chain.is_body) for chain in self.chains]
        body = _smooth_union([part for part, is_body in found if is_body], self.blend[0])
        limbs = [part for part, is_body in found if not is_body]
        return np.maximum(_smooth_union([body, *limbs], self.blend[1]), -points[:, 1])

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bone of the capsule nearest to each point (k,), and the radius of the bone there (k,)."""
        capsules = [capsule for chain in self.chains for capsule in chain.capsules]
        distance = np.array([_distance(points, capsule) for capsule in capsules])
        best = distance.argmin(axis=0)
        radius = np.empty(len(points))
        for i in np.unique(best):
            chosen, capsule = best == i, capsules[i]
            radius[chosen] = _at(capsule.radius, _along(points[chosen], capsule.ends))
        return np.array([capsule.bone for capsule in capsules])[best], radius

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box that contains the surface and leaves a margin."""
        capsules = [capsule for chain in self.chains for capsule in chain.capsules]
        ends = np.array([capsule.ends for capsule in capsules])
        widest = np.array([capsule.radius.max() * max(1.0, capsule.width.max()) for capsule in capsules])
        reach = (widest + 2.0 * self.blend[1])[:, None]
        return (ends.min(axis=1) - reach).min(axis=0), (ends.max(axis=1) + reach).max(axis=0)


def make_rig(species: dict[str, Any]) -> Rig:
    """Make the rig of a species from its table in animals.yaml."""
    bones: list[str] = []
    parents: list[int] = []
    joints: list[np.ndarray] = []
    limbs: list[int] = []
    chains: list[Chain] = []
    for table in species["chains"]:
        for side in ("_l", "_r") if table.get("mirrored") else ("",):
            mirror = np.array([-1.0 if side == "_r" else 1.0, 1.0, 1.0, 1.0, 1.0])
            nodes = mirror * table["nodes"]
            normal = mirror[:3] * table.get("normal", [1.0, 0.0, 0.0])
            parent = table.get("parent")
            current = -1 if parent is None else bones.index(parent if parent in bones else parent + side)
            capsules: list[Capsule] = []
            for k in range(len(nodes) - 1):
                if k < len(table.get("bones", ())):
                    bones.append(table["bones"][k] + side)
                    parents.append(current)
                    joints.append(nodes[k, :3])
                    limbs.append(-1 if table.get("body") else len(chains))
                    current = len(bones) - 1
                capsules.extend(_capsules(current, _curve(nodes, k), normal))
            chains.append(Chain(tuple(capsules), bool(table.get("body"))))
    blend = np.array(species["blend"])
    return Rig(tuple(bones), np.array(parents), np.array(joints), np.array(limbs), tuple(chains), blend)


def _curve(nodes: np.ndarray, k: int) -> np.ndarray:
    """Points (PIECES + 1, 5) of the cubic spline through the nodes, from node k to the next.

    Tangents are those of Catmull and Rom, with the shorter length where neighbouring segments differ.
    """
    step = np.diff(nodes, axis=0)
    length = np.linalg.norm(step[:, :3], axis=1)[:, None]
    tangent = np.concatenate(
        [step[:1] / length[:1], (step[1:] + step[:-1]) / (length[1:] + length[:-1]), step[-1:] / length[-1:]]
    )
    t = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    start, end = length[k] * tangent[k], length[k] * tangent[k + 1]
    return (
        nodes[k] * (1 - t) ** 2 * (1 + 2 * t)
        + start * t * (1 - t) ** 2
        + nodes[k + 1] * t**2 * (3 - 2 * t)
        - end * t**2 * (1 - t)
    )


def _capsules(bone: int, points: np.ndarray, normal: np.ndarray) -> list[Capsule]:
    """Capsules between successive points (k, 5)."""
    made = []
    for pair in zip(points[:-1], points[1:], strict=True):
        both = np.array(pair)
        ends, radius, width = both[:, :3], both[:, 3], both[:, 4]
        made.append(Capsule(bone, ends, radius, width, _perpendicular(normal, ends)))
    return made


def _perpendicular(normal: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Unit vector (3,) of the normal's part that is perpendicular to the axis."""
    axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    across = normal - (normal @ axis) * axis
    return across / np.linalg.norm(across)


def _along(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    axis = ends[1] - ends[0]
    return np.clip((points - ends[0]) @ axis / (axis @ axis), 0.0, 1.0)


def _at(values: np.ndarray, along: np.ndarray) -> np.ndarray:
    return values[0] + along * (values[1] - values[0])


def _distance(points: np.ndarray, capsule: Capsule) -> np.ndarray:
    """Approximate distances (k,) to a capsule, exact to first order near the surface."""
    along = _along(points, capsule.ends)
    away = points - capsule.ends[0] - along[:, None] * (capsule.ends[1] - capsule.ends[0])
    # The section is a circle after a stretch along the normal.
    stretch = 1.0 / _at(capsule.width, along)
    square, across = np.einsum("kc,kc->k", away, away), (away @ capsule.normal) ** 2
    length = np.sqrt(np.maximum(square + (stretch**2 - 1.0) * across, 1e-24))
    slope = np.sqrt(np.maximum(square + (stretch**4 - 1.0) * across, 1e-24)) / length
    return (length - _at(capsule.radius, along)) / slope


def _union(points: np.ndarray, capsules: tuple[Capsule, ...]) -> np.ndarray:
    """Distances (k,) to the nearest capsule."""
    return np.min([_distance(points, capsule) for capsule in capsules], axis=0)


def _smooth_union(distances: list[np.ndarray], blend: float) -> np.ndarray:
    """Smooth union -b log(sum of exp(-d_i / b)) of distances d_i, b = `blend`."""
    d = np.array(distances)
    nearest = d.min(axis=0)
    return nearest - blend * np.log(np.exp((nearest - d) / blend).sum(axis=0))
