"""Distances to the ground truth: between surfaces, and between vertices.

The surface distances follow the isometric experiment of the paper. Both shapes are scaled so that the ground
truth fits the unit sphere: the mean of its vertices is the origin, and the largest distance of a vertex is 1.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformation import volume_change
from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import angle_between


@metric(
    "-", "largest distance of a vertex to the other surface, the truth in the unit sphere", "truth", "posed"
)
def hausdorff(deformed: Deformed) -> float:
    """Return d_H, the largest distance of a vertex of one shape to the other surface; no unit."""
    there, back = deformed.surface_distances
    return float(np.sqrt(max(there.max(), back.max())))


@metric(
    "-",
    "mean squared distance of vertices to the other surface, both ways added, scaled as d_H",
    "truth",
    "posed",
)
def chamfer(deformed: Deformed) -> float:
    """Return d_C, the sum of the two mean squared distances of vertices to the other surface; no unit."""
    there, back = deformed.surface_distances
    return float(there.mean() + back.mean())


@metric("%", "mean distance of vertices to their true places / diagonal", "truth")
def truth_distance(deformed: Deformed) -> float:
    """Return the mean distance of a vertex to its true position over M's diagonal, in percent."""
    return 100 * float(_misplacement(deformed).mean()) / deformed.mesh.diagonal


@metric("%", "95th percentile of the distance of vertices to their true places / diagonal", "truth")
def truth_distance_95(deformed: Deformed) -> float:
    """Return the 95th percentile of the distances to the true positions, in percent of M's diagonal."""
    return 100 * float(np.percentile(_misplacement(deformed), 95)) / deformed.mesh.diagonal


@metric("deg", "mean over true area of the angle between a face's normal and its true one", "truth")
def truth_normal(deformed: Deformed) -> float:
    """Return the mean angle between the normals of M' and the ground truth, in degrees.

    The weights are the true areas of the faces. Faces without a normal in either shape do not count.
    """
    angle = angle_between(deformed.shape.face_normals, deformed.truth.face_normals)
    weight = np.where(deformed.shape.face_areas > 0, deformed.truth.face_areas, 0.0)
    return float(np.degrees((weight * angle).sum() / weight.sum())) if weight.any() else np.nan


@metric("%", "|V_M' - V_true| / V_true (closed meshes only)", "truth")
def truth_volume(deformed: Deformed) -> float:
    """Return the difference of the volume to the true one in percent; NaN unless M is closed and oriented."""
    return volume_change(deformed, deformed.truth)


@metric("%", "mean over edges of |length - true length| / longest true edge", "truth")
def truth_edge(deformed: Deformed) -> float:
    """Return EL against the ground truth: mean change of edge length over the longest true edge, in %."""
    true = deformed.truth.edge_lengths
    return 100 * float(np.abs(deformed.shape.edge_lengths - true).mean()) / float(true.max())


@metric("deg", "mean over corners of |angle - true angle|", "truth")
def truth_angle(deformed: Deformed) -> float:
    """Return FA against the ground truth: mean absolute difference of corner angles, in degrees."""
    return float(np.degrees(np.abs(deformed.shape.corner_angles - deformed.truth.corner_angles).mean()))


def _misplacement(deformed: Deformed) -> np.ndarray:
    """Return the distances (n,) of the vertices to their true positions."""
    return np.linalg.norm(deformed.shape.V - deformed.truth.V, axis=1)
