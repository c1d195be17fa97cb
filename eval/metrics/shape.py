"""Geometry of a mesh and of its deformed positions; each quantity is computed once.

Arrays of points have shape (3, k). Sums and products are several times faster in this order than over the
rows of (k, 3).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from eval.metrics.intersections import intersecting_faces
from sshade.mesh.sides import sides_by_edge

#: A face is inverted if its normal times the sum of its neighbours' normals is below this bound. The bound is
#: below zero, because the sum can cancel to rounding noise on a fold.
OPPOSED = -1e-9


class ShapeTopology:
    """Faces F (m, 3) of n vertices, with their edges and pairs of adjacent faces."""

    def __init__(self, F: np.ndarray, n: int) -> None:
        self.F, self.n = F, n
        self._sides = sides_by_edge(F, n)

    @cached_property
    def edges(self) -> np.ndarray:
        """(2, e) ends of the edges."""
        return np.ascontiguousarray(self._sides.ends.T)

    @cached_property
    def face_edges(self) -> np.ndarray:
        """(m, 3) edge from each corner of each face to the next corner."""
        return self._sides.edge

    @cached_property
    def on_boundary(self) -> np.ndarray:
        """(n,) bool: vertices at an edge with a single face."""
        found = np.zeros(self.n, dtype=bool)
        found[self._sides.ends[self._sides.faces == 1].ravel()] = True
        return found

    @cached_property
    def neighbours(self) -> csr_array:
        """(n, n) adjacency of the vertices."""
        i, j = np.hstack([self.edges, self.edges[::-1]])
        return csr_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(self.n, self.n))

    @cached_property
    def dihedral(self) -> np.ndarray:
        """(4, d) corners i, j, k, o of the two faces ijk and jio at each edge ij with a dihedral angle.

        Boundary edges, edges of more than two faces, and edges of faces with opposite orientations have none.
        """
        F, sides = self.F, self._sides
        first = sides.start[:-1][sides.faces == 2]
        one, two = (np.divmod(sides.side[first + k], 3) for k in range(2))
        i, j, k = (F[one[0], (one[1] + c) % 3] for c in range(3))
        begin, apex = F[two[0], two[1]], F[two[0], (two[1] + 2) % 3]
        return np.stack([i, j, k, apex])[:, begin == j]


class FirstForm(NamedTuple):
    """E, F, G (m,) for the two edges at each face's first corner, and ``sqrt(EG - F^2)``."""

    E: np.ndarray
    F: np.ndarray
    G: np.ndarray
    root: np.ndarray


class MeasuredShape:
    """Positions V (n, 3) for a topology, with the geometry of the surface."""

    def __init__(self, topology: ShapeTopology, V: np.ndarray) -> None:
        self.topology = topology
        self.V = np.ascontiguousarray(V, dtype=np.float64)

    @cached_property
    def columns(self) -> np.ndarray:
        """(3, n) the coordinates of V."""
        return np.ascontiguousarray(self.V.T)

    @cached_property
    def corners(self) -> np.ndarray:
        """(3, 3, m) positions by corner, coordinate and face."""
        return np.stack([self.columns[:, ids] for ids in self.topology.F.T])

    @cached_property
    def crosses(self) -> np.ndarray:
        """(3, m) normals of the faces with twice the area as length."""
        a, b, c = self.corners
        return cross(b - a, c - a)

    @cached_property
    def face_areas(self) -> np.ndarray:
        """(m,) areas of the faces."""
        return 0.5 * norm(self.crosses)

    @cached_property
    def face_normals(self) -> np.ndarray:
        """(3, m) unit normals; zero for faces without area."""
        length = norm(self.crosses)
        return np.divide(self.crosses, length, out=np.zeros_like(self.crosses), where=length > 0)

    @cached_property
    def area(self) -> float:
        """Total area."""
        return float(self.face_areas.sum())

    @cached_property
    def volume(self) -> float:
        """Signed enclosed volume; meaningful on closed, consistently oriented meshes only."""
        # Moments about the centre of the bounding box; far from the origin the sum would cancel.
        centre = 0.5 * (self.V.min(axis=0) + self.V.max(axis=0))
        a, b, c = self.corners - centre[:, None]
        return float(dot(a, cross(b, c)).sum() / 6.0)

    @cached_property
    def edge_lengths(self) -> np.ndarray:
        """(e,) lengths of the edges."""
        i, j = self.topology.edges
        return norm(self.columns[:, i] - self.columns[:, j])

    @cached_property
    def corner_angles(self) -> np.ndarray:
        """(m, 3) angle at each corner in radians, zero next to an edge without length.

        In contrast to arccos, atan2 of cross and dot product keeps its digits at 0 and pi.
        """
        angles = np.empty(self.topology.F.shape)
        for i in range(3):
            p, q, r = (self.corners[(i + c) % 3] for c in range(3))
            angles[:, i] = angle_between(q - p, r - p)
        return angles

    @cached_property
    def dihedral_angles(self) -> np.ndarray:
        """(d,) signed angle between the two face normals at each dihedral edge, in radians.

        Zero on flat and positive on convex surfaces; atan2 keeps its digits at 0 and pi.
        """
        i, j, k, o = (self.columns[:, ids] for ids in self.topology.dihedral)
        edge = j - i
        first, second = cross(edge, k - i), cross(o - i, edge)
        return np.arctan2(dot(cross(first, second), edge), dot(first, second) * norm(edge))

    @cached_property
    def first_form(self) -> FirstForm:
        """First fundamental form of each face in the basis of its edges."""
        a, b, c = self.corners
        u, v = b - a, c - a
        return FirstForm(dot(u, u), dot(u, v), dot(v, v), norm(self.crosses))

    @cached_property
    def opposed(self) -> np.ndarray:
        """(m,) bool: the normal of the face opposes the sum of the normals of its edge-neighbours."""
        normals, ids = self.face_normals, self.topology.face_edges
        product = np.zeros(len(ids))
        for normal in normals:
            at_edge = np.bincount(ids.ravel(), np.repeat(normal, 3))
            # The sums at the three edges include the face itself three times.
            product += normal * (at_edge[ids].sum(axis=1) - 3 * normal)
        return product < OPPOSED

    @cached_property
    def intersecting(self) -> np.ndarray:
        """(m,) bool: faces that intersect other faces; see :mod:`eval.metrics.intersections`."""
        return intersecting_faces(self.V, self.topology.F)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot products (k,) of points (3, k)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: np.ndarray) -> np.ndarray:
    """Return the lengths (k,) of points (3, k)."""
    return np.sqrt(dot(a, a))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products (3, k) of points (3, k)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles (k,) between directions (3, k) in radians; zero if a direction has no length."""
    return np.arctan2(norm(cross(a, b)), dot(a, b))


def weighted_percentile(values: np.ndarray, weights: np.ndarray, percent: float) -> float:
    """Return the smallest value v: `percent` of the weight has values up to v; NaN without values."""
    if not len(values):
        return np.nan
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    place = min(np.searchsorted(total, percent / 100 * total[-1]), len(order) - 1)
    return float(values[order[place]])
