"""Slides: the planes, lines and surfaces on which sliding handles move."""

from __future__ import annotations

import atexit
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh, require_mesh

#: Distance from a surface above which the offset of a point gives the normal, as a fraction of the diagonal.
OFF_SURFACE = 1e-9
#: Difference of a length from 1 that rounding explains.
UNIT = 1e-15
#: Search trees of surfaces. libigl complains about trees that outlive it.
_TREES: WeakKeyDictionary[Mesh, tuple[Any, np.ndarray, np.ndarray, np.ndarray]] = WeakKeyDictionary()
atexit.register(_TREES.clear)


@dataclass(frozen=True, eq=False)
class Slide:
    """The set on which a handle moves freely; make one with :meth:`plane`, :meth:`line` and so on.

    A plane or line passes through the target of its handle. Each handle of a group has its own plane or line,
    and all of them are parallel. Handles on one surface share the surface, and their targets have no effect.

    Attributes
    ----------
    across : (c, 3) float64
        Orthonormal directions in which a handle on a plane or a line is fixed; none if it moves anywhere.
    surface : Mesh, optional
        Surface that takes the place of a plane or line.
    record : mapping
        The keys of a handle file for this slide.
    """

    across: np.ndarray
    surface: Mesh | None = None
    record: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def plane(cls, normal: ArrayLike) -> Slide:
        """Slide on a plane with a normal (3,) of any length but 0; raise InputError on another array."""
        n = _direction(normal, "the normal of a plane")
        return cls(n[None], record={"slide": {"plane": n.tolist()}})

    @classmethod
    def line(cls, direction: ArrayLike) -> Slide:
        """Slide on a line with a direction (3,) of any length but 0; raise InputError on another array."""
        d = _direction(direction, "the direction of a line")
        return cls(np.linalg.svd(d[None])[2][1:], record={"slide": {"line": d.tolist()}})

    @classmethod
    def axes(cls, free: str) -> Slide:
        """Slide along one or two coordinate axes, such as "x" or "yz"; raise InputError on another text."""
        if free not in ("x", "y", "z", "xy", "xz", "yz"):
            raise InputError(f'the axes of a slide are one or two of x, y and z, such as "xz", not {free!r}')
        return cls(np.eye(3)[[axis not in free for axis in "xyz"]], record={"slide": {"axes": free}})

    @classmethod
    def on(cls, surface: Mesh, *, name: str | None = None) -> Slide:
        """Slide on a surface, such as the rest shape itself.

        Parameters
        ----------
        surface : Mesh
            In the coordinates of the targets. Faces without area are ignored.
        name : str, optional
            Path of the surface in handle files, relative to the file, or "rest".

        Raises
        ------
        InputError
            If no face has an area.
        """
        require_mesh(surface, "Slide.on")
        if surface.m == 0 or surface.without_area.all():
            raise InputError("the surface of a slide has no face with an area")
        record = {} if name is None else {"slide": {"surface": name}}
        return cls(np.empty((0, 3)), surface, record)

    @classmethod
    def anywhere(cls) -> Slide:
        """Leave the position free, for a handle that prescribes a rotation only."""
        return cls(np.empty((0, 3)), record={"free": "position"})

    @property
    def free(self) -> bool:
        """Whether the position is free."""
        return self.surface is None and len(self.across) == 0

    @property
    def arrays(self) -> list[np.ndarray]:
        """All arrays that determine the slide."""
        return [self.across] if self.surface is None else [self.surface.V, self.surface.F]

    def moves_as(self, other: Slide) -> bool:
        """Whether another slide leaves a handle the same freedom."""
        if self.surface is other.surface:
            return np.array_equal(self.across, other.across)
        both = self.surface is not None and other.surface is not None
        return both and all(map(np.array_equal, self.arrays, other.arrays))

    def nearest(self, points: np.ndarray, targets: np.ndarray) -> Nearest:
        """Return the nearest allowed positions of points (k, 3) of handles with targets (k, 3)."""
        if self.surface is None:
            off = (points - targets) @ self.across.T
            number = np.repeat(np.arange(len(points)), len(self.across))
            return Nearest(points - off @ self.across, number, np.tile(self.across, (len(points), 1)))
        tree, V, F, normals = _tree(self.surface)
        _, face, position = tree.squared_distance(V, F, np.ascontiguousarray(points))
        off, face = points - position, np.ravel(face)
        length = np.linalg.norm(off, axis=1)
        is_off = length > OFF_SURFACE * self.surface.diagonal
        across = np.where(is_off[:, None], off / np.where(is_off, length, 1.0)[:, None], normals[face])
        return Nearest(position, np.arange(len(points)), across)


class Nearest(NamedTuple):
    """The nearest allowed positions of k sliding handles, and the directions in which they are fixed there.

    Attributes
    ----------
    position : (k, 3) float64
    number : (c,) int
        Handle of each direction.
    across : (c, 3) float64
        Unit vectors; those of one handle are orthogonal.
    """

    position: np.ndarray
    number: np.ndarray
    across: np.ndarray


def _tree(surface: Mesh) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray]:
    """Return a search tree of a surface, its vertices, its faces that have an area, and their normals."""
    found = _TREES.get(surface)
    if found is None:
        import igl

        kept = ~surface.without_area
        V, F, tree = surface.V, surface.F[kept], igl.AABB()
        tree.init(V, F)
        found = _TREES[surface] = tree, V, F, surface.face_normals[kept]
    return found


def nearest(slides: np.ndarray, points: np.ndarray, targets: np.ndarray) -> Nearest:
    """Return the nearest allowed positions of points (k, 3) on their `slides` (k,)."""
    position, number, across = points.copy(), [], []
    for slide in {id(slide): slide for slide in slides}.values():
        own = np.flatnonzero(slides == slide)
        found = slide.nearest(points[own], targets[own])
        position[own] = found.position
        number.append(own[found.number])
        across.append(found.across)
    return Nearest(position, np.concatenate(number), np.concatenate(across))


def checked_slides(slide: Any, k: int) -> np.ndarray | None:
    """Return the slides (k,) of handles, given as one for all or one for each; None if no handle slides."""
    if slide is None:
        return None
    slides = np.empty(k, dtype=object)
    if isinstance(slide, Slide):
        slides[:] = slide
    elif len(slide) == k:
        slides[:] = list(slide)
    else:
        raise InputError(f"{k} handles have {len(slide)} slides; each needs one, or None")
    if not all(one is None or isinstance(one, Slide) for one in slides):
        raise InputError("the slide of a handle is a sshade.Slide, or None")
    return slides if (slides != None).any() else None  # noqa: E711 - of each element


def slide_numbers(slides: Sequence[Slide | None]) -> np.ndarray:
    """Return a number (k,) int64 for each slide, -1 for None; equal slides have equal numbers."""
    distinct = list({id(slide): slide for slide in slides if slide is not None}.values())
    first: dict[bytes, list[int]] = {}
    number = {id(None): -1}
    for i, slide in enumerate(distinct):
        alike = first.setdefault(slide.across.tobytes(), [])
        equal = next((j for j in alike if slide.moves_as(distinct[j])), i)
        if equal == i:
            alike.append(i)
        number[id(slide)] = equal
    return np.array([number[id(slide)] for slide in slides], dtype=np.int64)


def _direction(values: ArrayLike, name: str) -> np.ndarray:
    """Return a unit vector."""
    d = np.asarray(values, dtype=np.float64)
    if d.shape != (3,) or not np.isfinite(d).all() or not d.any():
        raise InputError(f"{name} is three finite numbers that are not all 0, not {d.tolist()}")
    largest = np.abs(d).max()
    d = d / largest if not 1e-9 < largest < 1e9 else d  # its square may overflow
    length = float(np.linalg.norm(d))
    # A unit vector stays as it is, so that files which are read and written again have the same slides.
    return d if abs(length - 1) <= UNIT else d / length
