"""Faces of a mesh that intersect other faces, from libigl's exact predicates.

Two faces intersect in one of three cases:

* They share no corner and have a common point; touching counts. The decision is exact, by signs of
  determinants (P. Guigue, O. Devillers, "Fast and robust triangle-triangle overlap test using orientation
  predicates", 2003; with J. R. Shewchuk's arithmetic). A face that has collapsed into a segment counts like
  any other face. A face that has shrunk into a point is excluded.
* They share one corner, and one face crosses the opposite side of the other face. The decision uses floating
  point, so faces that only touch may count or not.
* They share an edge and overlap in a plane, up to 1e-8 of the size of a face. Neighbours with opposite
  orientations and duplicate faces do not count.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

#: Largest ratio of twice the area to the squared longest side at which a face may be a segment or a point.
THIN = 1e-10


def intersecting_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return a mask (m,) of the faces that intersect another face of the mesh.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    """
    import igl.predicates

    found = np.zeros(len(F), dtype=bool)
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
