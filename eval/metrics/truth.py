"""Distances to a known result: between surfaces, and vertex by vertex.

The surface distances are those of the isometric experiment: both shapes are
moved by the mean of the true vertices and divided by the largest distance of a
true vertex to it, which puts the truth into the unit sphere.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.geometry import corner_angles, edge_lengths
from eval.metrics.registry import Task, metric
from sshade.mesh.mesh import Mesh


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


@metric("%", "95th percentile of the distance of vertices to their true places / diagonal", needs="truth")
def truth_distance_95(task: Task, vertices: np.ndarray) -> float:
    """95th percentile of the distance of a vertex to its true place over M's diagonal, in percent."""
    return 100 * float(np.percentile(np.linalg.norm(vertices - task.truth, axis=1), 95)) / task.mesh.diagonal


@metric("deg", "mean over true area of the angle between a face's normal and its true one", needs="truth")
def truth_normal(task: Task, vertices: np.ndarray) -> float:
    """Mean angle between a face's normal and its true one, weighted by its true area, in degrees.

    Faces without a normal in either shape are left out.
    """
    found, true = Mesh(vertices, task.mesh.F), Mesh(task.truth, task.mesh.F)
    a, b = found.face_normals, true.face_normals
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    weight = np.where(found.face_areas > 0, true.face_areas, 0.0)
    return float(np.degrees((weight * angle).sum() / weight.sum())) if weight.any() else np.nan


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
