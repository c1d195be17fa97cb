"""Distances to a known result: between surfaces, and vertex by vertex.

The surface distances are those of the isometric experiment: both shapes are
moved by the mean of the true vertices and divided by the largest distance of a
true vertex to it, which puts the truth into the unit sphere.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.geometry import corner_angles, edge_lengths
from eval.metrics.registry import Task, metric


@metric("-", "largest distance of a vertex to the other surface, the truth in the unit sphere", needs="truth")
def hausdorff(task: Task, vertices: np.ndarray) -> float:
    """d_H: the largest distance of a vertex of one shape to the surface of the other; no unit."""
    there, back = _squared_distances(task, vertices)
    return float(np.sqrt(max(there.max(), back.max())))


@metric(
    "-",
    "mean squared distance of vertices to the other surface, both ways added, scaled as d_H",
    needs="truth",
)
def chamfer(task: Task, vertices: np.ndarray) -> float:
    """d_C: the two mean squared distances of vertices to the other surface, added; no unit."""
    there, back = _squared_distances(task, vertices)
    return float(there.mean() + back.mean())


@metric("%", "mean distance of vertices to their true places / diagonal", needs="truth")
def truth_distance(task: Task, vertices: np.ndarray) -> float:
    """Mean distance of a vertex to its true place over M's diagonal, in percent."""
    return 100 * float(np.linalg.norm(vertices - task.truth, axis=1).mean()) / task.mesh.diagonal


@metric("%", "mean over edges of |length - true length| / longest true edge", needs="truth")
def truth_edge(task: Task, vertices: np.ndarray) -> float:
    """EL against the truth: mean absolute difference of an edge's length over the longest true edge, in %."""
    true = edge_lengths(task.truth, task.mesh.edges)
    return 100 * float(np.abs(edge_lengths(vertices, task.mesh.edges) - true).mean()) / float(true.max())


@metric("deg", "mean over corners of |angle - true angle|", needs="truth")
def truth_angle(task: Task, vertices: np.ndarray) -> float:
    """FA against the truth: mean absolute difference of a corner's angle, in degrees."""
    F = task.mesh.F
    return float(np.degrees(np.abs(corner_angles(vertices, F) - corner_angles(task.truth, F)).mean()))


def _squared_distances(task: Task, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) squared distances of the result's vertices to the true surface, and the other way round."""
    import igl

    F = np.ascontiguousarray(task.mesh.F)
    centre = task.truth.mean(axis=0)
    true, found = task.truth - centre, vertices - centre
    scale = np.linalg.norm(true, axis=1).max()
    true, found = true / scale, found / scale
    there = igl.point_mesh_squared_distance(found, true, F)[0]
    return there, igl.point_mesh_squared_distance(true, found, F)[0]
