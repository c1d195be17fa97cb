"""Detail: does the relief of the surface rotate with the surface?"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import MeasuredShape, angle_between

#: Smallest distance of an angle from 0 and 180 degrees in a cotangent.
SMALLEST_ANGLE = np.radians(0.1)


@metric("deg", "mean angle between the Laplacian coordinates and the turned rest ones, by area x length")
def detail(deformed: Deformed) -> float:
    """Return the mean angle between Laplacian coordinates of M' and rotated coordinates of M, in degrees.

    The coordinate of a vertex i is ``d_i = sum_j w_ij (v_i - v_j)`` with the cotangent weights of M. The best
    rotation of the edges at i from M to M' (Kabsch, with the same weights) rotates d_i. The mean has weights
    "area of the vertex times length of d_i", because a flat surface has no detail. Boundary vertices do not
    count, because d_i is tangential there. NaN if no vertex counts.
    """
    rest, shape, n = deformed.rest, deformed.shape, deformed.mesh.n
    i, j = rest.topology.edges
    w = _edge_weights(rest)
    before, after = (each.columns[:, i] - each.columns[:, j] for each in (rest, shape))
    d, d_deformed = (
        np.stack([np.bincount(i, x, n) - np.bincount(j, x, n) for x in w * edges])
        for edges in (before, after)
    )
    # A negative weight would rotate in the wrong direction.
    weighted = np.abs(w) * after
    S = np.stack([np.bincount(i, x * y, n) + np.bincount(j, x * y, n) for x in weighted for y in before])
    U, _, Vt = np.linalg.svd(S.T.reshape(-1, 3, 3))
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    angle = angle_between(np.einsum("nij,jn->in", U @ Vt, d), d_deformed)
    area = np.bincount(deformed.mesh.F.ravel(), np.repeat(rest.face_areas / 3, 3), minlength=n)
    length = np.linalg.norm(d, axis=0)
    weight = area * length
    # On a flat surface, rounding leaves coordinates of about 1e-16 edge lengths.
    weight[length < 1e-12 * deformed.mesh.diagonal] = 0.0
    weight[rest.topology.on_boundary] = 0.0
    return float(np.degrees((weight * angle).sum() / weight.sum())) if weight.any() else np.nan


def _edge_weights(rest: MeasuredShape) -> np.ndarray:
    """(e,) half the sum of the cotangents opposite to each edge."""
    angle = np.clip(rest.corner_angles, SMALLEST_ANGLE, np.pi - SMALLEST_ANGLE)
    opposite = rest.topology.face_edges[:, [1, 2, 0]]
    return np.bincount(opposite.ravel(), (0.5 / np.tan(angle)).ravel())
