"""What metrics are made of: the geometry of a mesh and of its deformed positions, each computed once.

Arrays of points are kept by coordinate, (3, k): sums and products over them are several times
faster than over the rows of (k, 3).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from eval.metrics.intersections import intersecting_faces
from sshade.mesh.sides import sides_by_edge

#: A normal and the mean of those around it are opposed from this product of unit vectors on:
#: on a fold the mean can cancel to rounding noise, which is no direction.
OPPOSED = -1e-9


class Topology:
    """The faces F (m, 3) of n vertices, and what edges and dihedral angles they make."""

    def __init__(self, F: np.ndarray, n: int) -> None:
        self.F, self.n = F, n
        self._sides = sides_by_edge(F, n)

    @cached_property
    def edges(self) -> np.ndarray:
        """(2, e) the ends of the edges."""
        return np.ascontiguousarray(self._sides.ends.T)

    @cached_property
    def face_edges(self) -> np.ndarray:
        """(m, 3) the edge from each corner of each face to the next."""
        return self._sides.edge

    @cached_property
    def on_boundary(self) -> np.ndarray:
        """(n,) bool: vertices at an edge of one face."""
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
        """(4, d) corners i, j, k, o of the two faces ijk and jio at each edge ij that has a dihedral angle.

        Edges of the boundary, of more than two faces, or of faces wound against each other have none.
        """
        F, sides = self.F, self._sides
        first = sides.start[:-1][sides.faces == 2]
        one, two = (np.divmod(sides.side[first + k], 3) for k in range(2))
        i, j, k = (F[one[0], (one[1] + c) % 3] for c in range(3))
        begin, apex = F[two[0], two[1]], F[two[0], (two[1] + 2) % 3]
        return np.stack([i, j, k, apex])[:, begin == j]


class FirstForm(NamedTuple):
    """E, F, G (m,) of the two edges at each face's first corner, and ``sqrt(EG - F^2)``."""

    E: np.ndarray
    F: np.ndarray
    G: np.ndarray
    root: np.ndarray


class Shape:
    """Positions V (n, 3) of the vertices of a topology, and the geometry of the surface."""

    def __init__(self, topology: Topology, V: np.ndarray) -> None:
        self.topology = topology
        self.V = np.ascontiguousarray(V, dtype=np.float64)

    @cached_property
    def columns(self) -> np.ndarray:
        """(3, n) the coordinates of V."""
        return np.ascontiguousarray(self.V.T)

    @cached_property
    def corners(self) -> np.ndarray:
        """(3, 3, m) by corner of the faces, coordinate, face."""
        return np.stack([self.columns[:, ids] for ids in self.topology.F.T])

    @cached_property
    def crosses(self) -> np.ndarray:
        """(3, m) twice the faces' area along their normals."""
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
        # Moments about the centre of the box: far from the origin the sum would cancel.
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
        """(m, 3) angle at each corner in radians, zero where an edge has no length.

        atan2 of cross and dot product: unlike arccos it keeps its digits at 0 and pi.
        """
        angles = np.empty(self.topology.F.shape)
        for i in range(3):
            p, q, r = (self.corners[(i + c) % 3] for c in range(3))
            angles[:, i] = angle_between(q - p, r - p)
        return angles

    @cached_property
    def dihedral_angles(self) -> np.ndarray:
        """(d,) signed angle between the normals of the faces at each dihedral edge, in radians.

        Zero where they are flat, positive where the surface is convex; atan2 keeps its digits at 0 and pi.
        """
        i, j, k, o = (self.columns[:, ids] for ids in self.topology.dihedral)
        edge = j - i
        first, second = cross(edge, k - i), cross(o - i, edge)
        return np.arctan2(dot(cross(first, second), edge), dot(first, second) * norm(edge))

    @cached_property
    def first_form(self) -> FirstForm:
        """The first fundamental form of each face in the basis of its edges."""
        a, b, c = self.corners
        u, v = b - a, c - a
        return FirstForm(dot(u, u), dot(u, v), dot(v, v), norm(self.crosses))

    @cached_property
    def opposed(self) -> np.ndarray:
        """(m,) bool: the face's normal opposes the sum of those of the faces at its edges."""
        normals, ids = self.face_normals, self.topology.face_edges
        product = np.zeros(len(ids))
        for normal in normals:
            at_edge = np.bincount(ids.ravel(), np.repeat(normal, 3))
            # The sum at an edge holds the face itself, once for each of its three edges.
            product += normal * (at_edge[ids].sum(axis=1) - 3 * normal)
        return product < OPPOSED

    @cached_property
    def intersecting(self) -> np.ndarray:
        """(m,) bool: faces that intersect others; see :mod:`eval.metrics.intersections`."""
        return intersecting_faces(self.V, self.topology.F)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) products of points (3, k)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: np.ndarray) -> np.ndarray:
    """(k,) lengths of points (3, k)."""
    return np.sqrt(dot(a, a))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, k) cross products of points (3, k)."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
    )


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) angles between directions (3, k) in radians; zero where one has no length."""
    return np.arctan2(norm(cross(a, b)), dot(a, b))


def weighted_percentile(values: np.ndarray, weights: np.ndarray, percent: float) -> float:
    """The smallest value that at least `percent` of the weight does not exceed; NaN of nothing."""
    if not len(values):
        return np.nan
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order[min(np.searchsorted(share, percent / 100 * share[-1]), len(order) - 1)]])
