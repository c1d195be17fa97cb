"""Creases and detail: changes of dihedral angles, and whether the relief of the surface turns with it.

A smooth bend of a joint and a sharp fold may have the same mean change of lengths and angles, but a fold is
visible. A handle of one vertex can pull a spike out of the surface, which changes the angles around it.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import MeasuredShape, angle_between

#: Number of rings of edges around a group of handles in which spikes are measured.
RINGS = 3


@metric("deg", "mean over edges of |change of the dihedral angle|")
def bend(deformed: Deformed) -> float:
    """Return the mean absolute change of the dihedral angle over the edges of M, in degrees."""
    change = deformed.dihedral_changes
    return float(change.mean()) if len(change) else np.nan


@metric("deg", "99.9th percentile of |change of the dihedral angle|")
def bend_tail(deformed: Deformed) -> float:
    """Return the 99.9th percentile of the absolute change of the dihedral angle, in degrees."""
    change = deformed.dihedral_changes
    return float(np.percentile(change, 99.9)) if len(change) else np.nan


@metric(
    "deg", "99th percentile of |change of the dihedral angle| within 3 rings of a handle group", "handles"
)
def spike(deformed: Deformed) -> float:
    """Return the 99th percentile of the changes within three rings of a handle group, in degrees.

    The metric is the largest value of a group. An edge is within r rings if one of its ends is at most r - 1
    edges from a handle of the group.
    """
    topology, handles = deformed.rest.topology, deformed.task.handles
    ends = topology.dihedral[:2]
    worst = np.nan
    for group in np.unique(handles.group):
        near = np.unique(handles.index[handles.group == group])
        for _ in range(RINGS - 1):
            near = np.union1d(near, topology.neighbours[near].indices)
        inside = np.zeros(topology.n, dtype=bool)
        inside[near] = True
        around = deformed.dihedral_changes[inside[ends].any(axis=0)]
        if len(around):
            worst = np.fmax(worst, np.percentile(around, 99))
    return float(worst)


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
