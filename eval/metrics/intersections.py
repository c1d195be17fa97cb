"""Which faces of a mesh intersect others, by libigl's exact predicates; no method has a part in it.

Two faces intersect where

* they have no corner in common, and any point in common, touching included: decided exactly,
  by signs of determinants (P. Guigue, O. Devillers, "Fast and robust triangle-triangle overlap
  test using orientation predicates", 2003; J. R. Shewchuk's arithmetic). A face that has
  collapsed into a segment is no exception; one that has shrunk into a point, which runs
  through nothing, is left out;
* they have one corner in common, and one passes through the side of the other that is opposite
  to it: in floating point, so that faces which only touch there may count or not;
* they have an edge in common and lie flat on each other, to 1e-8 of a face's size. Neighbours
  that are wound against each other do not count, nor does a face that is there twice.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

#: Twice a face's area over its longest side squared, below which the face may be a segment or a point.
THIN = 1e-10


def intersecting_faces(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(m,) bool: faces that intersect another one of the mesh.

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
    _, pairs, coplanar = igl.predicates.find_self_intersections(np.array(V), F)  # a copy that it may write to
    if len(pairs):
        found[extended[pairs[_confirmed(V, F, pairs, coplanar.ravel())].ravel()]] = True
    return found


def _confirmed(V: np.ndarray, F: np.ndarray, pairs: np.ndarray, coplanar: np.ndarray) -> np.ndarray:
    """(k,) bool: which of libigl's pairs (k, 2) intersect.

    It tests faces with two common corners as if they had one, unless they run through their
    edge in opposite directions; and of a face without area the shadow on a plane.
    """
    one, two = F[pairs[:, 0]], F[pairs[:, 1]]
    common = (one[:, :, None] == two[:, None, :]).sum(axis=(1, 2))
    confirmed = (common < 2) | (coplanar != 0)
    for pair in np.flatnonzero((common == 0) & (_thin(V[one]) | _thin(V[two]))):
        confirmed[pair] = _meet(V[one[pair]], V[two[pair]])
    return confirmed


def _thin(triangles: np.ndarray) -> np.ndarray:
    """(k,) bool: triangles (k, 3, 3) that may have no area; exactly equal corners and those in a line do."""
    sides = triangles - triangles[:, [1, 2, 0]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return area <= THIN * (sides**2).sum(axis=2).max(axis=1)


def _meet(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether two triangles (3, 3), segments or points as they may be, have a point in common; exactly.

    Of two that have none, a plane across one of these directions is between them: the sides, the
    distance of two corners, the products of two of these, and the products of a product and one
    of these (separating axes, S. Gottschalk et al. 1996, in a space, a plane and a line).
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
