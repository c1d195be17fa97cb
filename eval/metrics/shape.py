"""Geometry of a mesh and of its deformed positions, each quantity once, and faces that intersect others.

Arrays of points have shape (3, k). Sums and products are several times faster in this order than over the
rows of (k, 3).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from sshade.mesh.incidence import sides_by_edge

#: A face is inverted if its normal times the sum of its neighbours' normals is below this bound. The bound is
#: below zero, because the sum can cancel to rounding noise on a fold.
OPPOSED = -1e-9
#: Largest ratio of twice the area to the squared longest side at which a face may be a segment or a point.
THIN = 1e-10
#: Largest number of pairs of faces with overlapping boxes for which intersections are searched, and number of
#: faces that the estimate of this number looks at. Poses of bodies have about 10 pairs a face.
PAIRS, LOOKED_AT = 1e7, 20
#: Extent of a mesh when its intersections are searched, up to a factor of two.
SIZE = 2.0**20


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
        return _arctan2(dot(cross(first, second), edge), dot(first, second) * norm(edge))

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
        """(m,) bool: faces that intersect other faces; see :func:`intersecting_faces`."""
        return intersecting_faces(self.V, self.topology.F)

    @property
    def is_scrambled(self) -> bool:
        """Whether so many faces may meet that their intersections would take hours, as of random vertices."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        low, high = (end[:, (low < high).any(axis=0)] for end in (low, high))
        faces = np.linspace(0, low.shape[1] - 1, LOOKED_AT if low.size else 0).astype(int)
        met = [
            np.count_nonzero(((high[:, face] >= low.T) & (low[:, face] <= high.T)).all(axis=1))
            for face in faces
        ]
        return sum(met) / LOOKED_AT * low.shape[1] / 2 > PAIRS


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
    return _arctan2(norm(cross(a, b)), dot(a, b))


def _arctan2(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return angles in radians; zero for zeros of any sign, with which a rigid motion may end."""
    return np.arctan2(y + 0.0, x + 0.0)  # -0.0 + 0.0 is 0.0


def weighted_percentile(values: np.ndarray, weights: np.ndarray, percent: float) -> float:
    """Return the smallest value v: `percent` of the weight has values up to v; NaN without values."""
    if not len(values):
        return np.nan
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    place = min(np.searchsorted(total, percent / 100 * total[-1]), len(order) - 1)
    return float(values[order[place]])


def intersecting_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return a mask (m,) of the faces that intersect another face of the mesh, by libigl's exact predicates.

    Two faces intersect in three cases:

    * They share no corner and have a common point; touching counts. The decision is exact, by signs of
      determinants (P. Guigue, O. Devillers, "Fast and robust triangle-triangle overlap test using orientation
      predicates", 2003; with J. R. Shewchuk's arithmetic). A face that has collapsed into a segment counts
      like any other face. A face that has shrunk into a point is excluded.
    * They share one corner, and one face crosses the opposite side of the other face. The decision uses
      floating point, so faces that only touch may count or not. It has an absolute tolerance, which is
      nothing for the size to which the mesh is scaled, :data:`SIZE`.
    * They share an edge and overlap in a plane, up to 1e-8 of the size of a face. Neighbours with opposite
      orientations and duplicate faces do not count.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    """
    import igl.predicates

    found = np.zeros(len(F), dtype=bool)
    extent = float(np.ptp(V, axis=0).max())
    V = np.ldexp(V, int(np.log2(SIZE / extent))) if extent > 0 else V  # by a power of two, which is exact
    first, second, third = V[F.T]
    extended = np.flatnonzero(((first != second) | (first != third)).any(axis=1))
    F = np.ascontiguousarray(F[extended])
    # libigl needs a writable copy.
    _, pairs, coplanar = igl.predicates.find_self_intersections(np.array(V), F)
    if len(pairs):
        found[extended[pairs[_confirmed(V, F, pairs, coplanar.ravel())].ravel()]] = True
    return found


def _confirmed(V: np.ndarray, F: np.ndarray, pairs: np.ndarray, coplanar: np.ndarray) -> np.ndarray:
    """Return a mask (k,) of libigl's pairs (k, 2) that really intersect.

    libigl is wrong in two cases. It treats faces with a common edge and opposite orientations as if they
    shared one corner. It projects faces without area onto a plane.
    """
    one, two = F[pairs[:, 0]], F[pairs[:, 1]]
    common = (one[:, :, None] == two[:, None, :]).sum(axis=(1, 2))
    confirmed = (common < 2) | (coplanar != 0)
    for pair in np.flatnonzero((common == 0) & (_thin(V[one]) | _thin(V[two]))):
        confirmed[pair] = _meet(V[one[pair]], V[two[pair]])
    return confirmed


def _thin(triangles: np.ndarray) -> np.ndarray:
    """Return a mask (k,) of triangles (k, 3, 3) that may have no area."""
    sides = triangles - triangles[:, [1, 2, 0]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return area <= THIN * (sides**2).sum(axis=2).max(axis=1)


def _meet(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether two triangles (3, 3) have a common point; exact, also for degenerate triangles.

    If they have none, a plane orthogonal to a separating axis lies between them (S. Gottschalk et al. 1996).
    Candidates for the axis are the sides, the vector between two corners, all cross products of two such
    vectors, and the cross products of a product with a vector. The last two cover triangles in a common plane
    or line.
    """
    numbers = [Fraction(x) for x in (*one.ravel(), *two.ravel())]
    scale = max(number.denominator for number in numbers)  # powers of two: integers from here on
    points = np.array([int(number * scale) for number in numbers], dtype=object).reshape(2, 3, 3)
    a, b = points
    within = np.array([*(a - a[[1, 2, 0]]), *(b - b[[1, 2, 0]]), b[0] - a[0]])
    i, j = np.triu_indices(len(within), 1)
    across = np.cross(within[i], within[j])
    axes = np.vstack([within, across, np.cross(across[:, None], within).reshape(-1, 3)])
    heights = axes @ points.transpose(0, 2, 1)
    low, high = heights.min(axis=2), heights.max(axis=2)
    return not ((high[0] < low[1]) | (high[1] < low[0])).any()
