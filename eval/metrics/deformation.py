"""What changes between the rest mesh and the deformed one.

Errors follow the paper, which follows D. Baieri, F. Maggioli, Z. Laehner,
S. Melzi, E. Rodola, "Implicit-ARAP", 2024: relative area and volume error, mean
edge-length change over the longest edge, mean face-angle change.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.geometry import corner_angles, edge_lengths
from eval.metrics.registry import Task, metric
from sshade.contact.flips import new_flips
from sshade.contact.intersections import new_crossings
from sshade.mesh.mesh import Mesh


@metric("%", "|V_M - V_M'| / V_M (closed meshes only)")
def volume(task: Task, vertices: np.ndarray) -> float:
    """Relative change of the enclosed volume in percent; NaN unless M is closed and oriented."""
    rest = task.mesh
    if not (rest.is_closed and rest.is_oriented) or rest.volume == 0:
        return np.nan
    return 100 * abs(Mesh(vertices, rest.F).volume - rest.volume) / abs(rest.volume)


@metric("%", "|A_M - A_M'| / A_M")
def area(task: Task, vertices: np.ndarray) -> float:
    """Relative change of the total surface area in percent."""
    rest = task.mesh
    return 100 * abs(Mesh(vertices, rest.F).area - rest.area) / rest.area


@metric("%", "mean over edges of |length change| / longest rest edge")
def edge(task: Task, vertices: np.ndarray) -> float:
    """Mean absolute change of an edge's length over the longest rest edge, in percent (EL)."""
    rest = task.mesh
    before = edge_lengths(rest.V, rest.edges)
    return 100 * float(np.abs(edge_lengths(vertices, rest.edges) - before).mean()) / float(before.max())


@metric("deg", "mean over corners of |angle change|")
def angle(task: Task, vertices: np.ndarray) -> float:
    """Mean absolute change of a corner's angle in degrees (FA, as the paper's table prints it)."""
    rest = task.mesh
    return float(np.degrees(np.abs(corner_angles(vertices, rest.F) - corner_angles(rest.V, rest.F)).mean()))


@metric("%", "mean over corners of |angle change| / rest angle")
def angle_relative(task: Task, vertices: np.ndarray) -> float:
    """Mean of a corner's angle change over its rest angle, in percent: the paper's formula.

    Rest faces of no area have an angle of zero to divide by: they are left out
    here and counted by :func:`zero_area_faces`. NaN if no face is left.
    """
    rest = task.mesh
    F = rest.F[rest.face_areas > 0]
    before = corner_angles(rest.V, F)
    # A needle's corner can round to zero although the area does not.
    usable = before > 0
    if not usable.any():
        return np.nan
    change = np.abs(corner_angles(vertices, F) - before)
    return 100 * float((change[usable] / before[usable]).mean())


@metric("count", "rest faces that angle_relative leaves out")
def zero_area_faces(task: Task, vertices: np.ndarray) -> float:
    """How many rest faces :func:`angle_relative` leaves out."""
    return float((task.mesh.face_areas == 0).sum())


@metric("%", "mean distance of handles to targets / diagonal", needs="handles")
def handle(task: Task, vertices: np.ndarray) -> float:
    """Mean distance of the handle vertices to their targets over M's diagonal, in percent."""
    gap = np.linalg.norm(vertices[task.handles.index] - task.handles.target, axis=1)
    return 100 * float(gap.mean()) / task.mesh.diagonal


@metric("count", "faces that oppose their neighbours in M' and not in M")
def flips(task: Task, vertices: np.ndarray) -> float:
    """Faces whose normal opposes the mean of their edge-neighbours' in M' and did not in M."""
    return float(new_flips(task.mesh, vertices).sum())


@metric("count", "faces that intersect others in M' and not in M")
def self_intersections(task: Task, vertices: np.ndarray) -> float:
    """Faces that intersect others in M' and did not in M; see :mod:`sshade.contact.intersections`."""
    return float(new_crossings(task.mesh, vertices).sum())
