"""Plane, cylinder, bar and cactus of a survey, generated at any resolution, with whole regions as handles.

M. Botsch and O. Sorkine, "On Linear Variational Surface Deformation Methods", TVCG 2008, lift the middle of a
bumpy plane, bend a cylinder by 120 degrees, twist a bar by 135 and bend a cactus by 70. Sizes, bumps and arms
are our own. One region of each shape is fixed, the other moves rigidly.

Cylinder and bar have a true pose. Between the regions the axis of the cylinder becomes a circular arc of the
same length, and the bar is twisted uniformly; sections keep their shape. The true pose is a kinematic ideal,
not the minimum of an elastic energy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from defaust.sources.generated import lattices
from defaust.sources.generated.cactus import BLEND, CAPSULES, cactus
from defaust.sources.generated.motions import Bend, Lift, Twist
from defaust.sources.source import Box, Region, Source, SourcePose, provenance_texts
from sshade import InputError, Mesh
from sshade.mesh.rigid import rigidly_moved
from sshade.problem.snapping import vertices_in

#: Approximate number of vertices of the registered meshes, and minimum number of vertices of any mesh.
LOW, FEWEST = 5000, 1000
#: Bumps of the plane [-1, 1] x [-1, 1]: height, and number of waves over a length of 1.
HEIGHT, WAVES = 0.05, 2.0
#: Distance from the plane's centre at which the fixed border begins, and half the width of the moved square.
BORDER, MIDDLE = 0.9, 0.3
#: Radius and length of the cylinder, and length of the bar, whose section has the side 1.
RADIUS, CYLINDER, BAR = 1.0, 12.0, 4.0
LIFTED, BENT, TWISTED, LEANING = (
    Lift(0.3),
    Bend(1.5, 10.5, 120.0),
    Twist(0.5, 3.5, 135.0),
    Bend(0.5, 5.2, 70.0),
)
#: Half the width of a box around the cactus's trunk without its arms, and of a box around any shape.
TRUNK, FAR = 1.0, 20.0

#: Names of the two landmarks, which datasets store.
HELD, MOVED = "held", "moved"
#: Definition of each shape. Datasets store it: true poses are computed for the same formulas only.
FORMULAS = {
    "plane": f"{HEIGHT} sin({2 * WAVES} pi x) sin({2 * WAVES} pi y), |x| and |y| at most 1; {LIFTED}",
    "cylinder": f"radius {RADIUS}, length {CYLINDER}; {BENT}",
    "bar": f"side 1.0, length {BAR}; {TWISTED}",
    "cactus": f"capsules {CAPSULES}, blended over {BLEND}; {LEANING}",
}


class GeneratedShape(NamedTuple):
    """A shape and its pose.

    Attributes
    ----------
    pose : str
        Name of the pose.
    triangulate : callable
        Returns vertices and faces for an approximate number of vertices.
    held, moved : tuple of boxes
        The fixed and the moved region.
    motion : Lift, Bend or Twist
    is_known : bool
        Whether the motion defines the pose of the whole shape, not only of the moved region.
    """

    pose: str
    triangulate: Callable[[int], tuple[np.ndarray, np.ndarray]]
    held: tuple[Box, ...]
    moved: tuple[Box, ...]
    motion: Lift | Bend | Twist
    is_known: bool

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions of the pose."""
        return Region(HELD, self.held), Region(MOVED, self.moved, *self.motion.end)

    def true_pose(self, V: np.ndarray) -> np.ndarray | None:
        """True positions (n, 3) of rest vertices (n, 3); None if unknown. Regions match their targets."""
        if not self.is_known:
            return None
        assert not isinstance(self.motion, Lift), "a lift moves a region only"
        posed = self.motion(V)
        for region in self.regions:
            index = vertices_in(V, region.boxes)
            posed[index] = rigidly_moved(V[index], region.rotation, region.translation)
        return posed


def bumpy_plane(vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate a square with bumps in rows and columns."""
    V, F = lattices.square(vertices)
    x, y = 2.0 * np.pi * WAVES * V[:, :2].T
    V[:, 2] = HEIGHT * np.sin(x) * np.sin(y)
    return V, F


def box(**intervals: tuple[float, float]) -> Box:
    """Box of intervals of x, y and z; a missing interval has no bounds."""
    x, y, z = (intervals.get(axis, (-FAR, FAR)) for axis in "xyz")
    return (x[0], y[0], z[0]), (x[1], y[1], z[1])


def upright(
    pose: str, triangulate: Callable[..., Any], motion: Bend | Twist, *, is_known: bool, **sides: Any
) -> GeneratedShape:
    """Shape along z that is fixed below its motion, and moves above; `sides` bound the moved region."""
    held, moved = box(z=(-FAR, motion.low)), box(z=(motion.high, FAR), **sides)
    return GeneratedShape(pose, triangulate, held=(held,), moved=(moved,), motion=motion, is_known=is_known)


OUTSIDE = (-FAR, -BORDER), (BORDER, FAR)
SHAPES = (
    GeneratedShape(
        "lift",
        bumpy_plane,
        held=(*(box(x=side) for side in OUTSIDE), *(box(y=side) for side in OUTSIDE)),
        moved=(box(x=(-MIDDLE, MIDDLE), y=(-MIDDLE, MIDDLE)),),
        motion=LIFTED,
        is_known=False,
    ),
    upright("bend", partial(lattices.cylinder, radius=RADIUS, length=CYLINDER), BENT, is_known=True),
    upright("twist", partial(lattices.bar, length=BAR), TWISTED, is_known=True),
    upright("bend", cactus, LEANING, is_known=False, x=(-TRUNK, TRUNK)),
)


@dataclass(frozen=True)
class Shapes(Source):
    """Source of plane, cylinder, bar and cactus; it has no parameters."""

    name = "shapes"
    subjects = tuple(range(len(SHAPES)))
    landmark_names = (HELD, MOVED)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Facts for the dataset card."""
        return {**provenance_texts("shapes"), "classes": list(FORMULAS), "formulas": FORMULAS}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        """The only pose of a shape."""
        shape = SHAPES[subject]
        return (SourcePose(shape.pose, self.landmark_names, regions=shape.regions),)

    def rest(self, subject: int) -> Mesh:
        """Mesh of about :data:`LOW` vertices."""
        return self.generated(subject, vertices=LOW)

    def generated(self, subject: int, *, vertices: int) -> Mesh:
        """Mesh of about this many vertices; InputError if too few for bumps and arms."""
        if vertices < FEWEST:
            raise InputError(f"generated shapes have {FEWEST} vertices or more, not {vertices}")
        return Mesh(*SHAPES[subject].triangulate(vertices))

    def posed(self, subject: int, pose: SourcePose) -> Mesh | None:
        """True pose of cylinder and bar; None for plane and cactus."""
        rest = self.rest(subject)
        V = SHAPES[subject].true_pose(rest.V)
        return None if V is None else Mesh(V, rest.F)


def ideal_pose(source: Mapping[str, object], subject: int, rest: Mesh) -> np.ndarray | None:
    """Compute the true pose (n, 3) of a generated rest mesh of any resolution; None if unknown.

    Parameters
    ----------
    source : mapping
        A dataset's record of its source, with ``formulas``.
    subject : int
    rest : Mesh

    Raises
    ------
    InputError
        When the dataset was built with other formulas.
    """
    if source["formulas"] != FORMULAS:
        raise InputError("this version generates the dataset's shapes by other formulas; build it again")
    return SHAPES[subject].true_pose(rest.V)
