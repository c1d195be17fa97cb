"""Distances to a known result: between surfaces, and vertex by vertex.

The surface distances are those of the isometric experiment: both shapes are
moved by the mean of the true vertices and divided by the largest distance of a
true vertex to it, which puts the truth into the unit sphere.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import angle_between


@metric(
    "-", "largest distance of a vertex to the other surface, the truth in the unit sphere", "truth", "posed"
)
def hausdorff(deformed: Deformed) -> float:
    """d_H: the largest distance of a vertex of one shape to the surface of the other; no unit."""
    there, back = deformed.surface_distances
    return float(np.sqrt(max(there.max(), back.max())))


@metric(
    "-",
    "mean squared distance of vertices to the other surface, both ways added, scaled as d_H",
    "truth",
    "posed",
)
def chamfer(deformed: Deformed) -> float:
    """d_C: the two mean squared distances of vertices to the other surface, added; no unit."""
    there, back = deformed.surface_distances
    return float(there.mean() + back.mean())


@metric("%", "mean distance of vertices to their true places / diagonal", "truth")
def truth_distance(deformed: Deformed) -> float:
    """Mean distance of a vertex to its true place over M's diagonal, in percent."""
    return 100 * float(_misplacement(deformed).mean()) / deformed.mesh.diagonal


@metric("%", "95th percentile of the distance of vertices to their true places / diagonal", "truth")
def truth_distance_95(deformed: Deformed) -> float:
    """95th percentile of the distance of a vertex to its true place over M's diagonal, in percent."""
    return 100 * float(np.percentile(_misplacement(deformed), 95)) / deformed.mesh.diagonal


@metric("deg", "mean over true area of the angle between a face's normal and its true one", "truth")
def truth_normal(deformed: Deformed) -> float:
    """Mean angle between a face's normal and its true one, weighted by its true area, in degrees.

    Faces without a normal in either shape are left out.
    """
    angle = angle_between(deformed.shape.face_normals, deformed.truth.face_normals)
    weight = np.where(deformed.shape.face_areas > 0, deformed.truth.face_areas, 0.0)
    return float(np.degrees((weight * angle).sum() / weight.sum())) if weight.any() else np.nan


@metric("%", "mean over edges of |length - true length| / longest true edge", "truth")
def truth_edge(deformed: Deformed) -> float:
    """EL against the truth: mean absolute difference of an edge's length over the longest true edge, in %."""
    true = deformed.truth.edge_lengths
    return 100 * float(np.abs(deformed.shape.edge_lengths - true).mean()) / float(true.max())


@metric("deg", "mean over corners of |angle - true angle|", "truth")
def truth_angle(deformed: Deformed) -> float:
    """FA against the truth: mean absolute difference of a corner's angle, in degrees."""
    return float(np.degrees(np.abs(deformed.shape.corner_angles - deformed.truth.corner_angles).mean()))


def _misplacement(deformed: Deformed) -> np.ndarray:
    """(n,) distances of the vertices to their true places."""
    return np.linalg.norm(deformed.shape.V - deformed.truth.V, axis=1)
