"""The quality metrics: pure functions of a task and of the deformed vertices.

M is the rest mesh and M' the deformed one, of the same connectivity; where the
task is a pose transfer, they are S and S'. A metric returns one number, NaN where
it is not available (volume of an open mesh).
Errors follow the paper, which follows D. Baieri, F. Maggioli, Z. Laehner,
S. Melzi, E. Rodola, "Implicit-ARAP", 2024: relative area and volume error, mean
edge-length change over the longest edge, mean face-angle change.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eval.metrics.geometry import corner_angles, edge_lengths
from eval.metrics.truth import Task, chamfer, hausdorff, truth_angle, truth_distance, truth_edge
from sshade.contact.flips import new_flips
from sshade.contact.intersections import new_crossings
from sshade.mesh.mesh import Mesh


@dataclass(frozen=True)
class Metric:
    """One number about a deformation.

    Parameters
    ----------
    name : str
        Its column in a row is ``metric.<name>``.
    unit : str
        ``%``, ``deg``, ``count``, or ``-`` for none.
    better : {"lower"}
        Which way is better.
    equation : str
        The definition in one line, for the legend of a table.
    function : callable
        ``(task, vertices (n, 3) float64) -> float``, NaN where not available.
    needs : {"mesh", "handles", "truth"}
        What a task must have; the others have no such column.
    """

    name: str
    unit: str
    better: Literal["lower"]
    equation: str
    function: Callable[[Task, np.ndarray], float]
    needs: Literal["mesh", "handles", "truth"] = "mesh"


def volume(task: Task, vertices: np.ndarray) -> float:
    """Relative change of the enclosed volume in percent; NaN unless M is closed and oriented."""
    rest = task.mesh
    if not (rest.is_closed and rest.is_oriented) or rest.volume == 0:
        return np.nan
    return 100 * abs(Mesh(vertices, rest.F).volume - rest.volume) / abs(rest.volume)


def area(task: Task, vertices: np.ndarray) -> float:
    """Relative change of the total surface area in percent."""
    rest = task.mesh
    return 100 * abs(Mesh(vertices, rest.F).area - rest.area) / rest.area


def edge(task: Task, vertices: np.ndarray) -> float:
    """Mean absolute change of an edge's length over the longest rest edge, in percent (EL)."""
    rest = task.mesh
    before = edge_lengths(rest.V, rest.edges)
    return 100 * float(np.abs(edge_lengths(vertices, rest.edges) - before).mean()) / float(before.max())


def angle(task: Task, vertices: np.ndarray) -> float:
    """Mean absolute change of a corner's angle in degrees (FA, as the paper's table prints it)."""
    rest = task.mesh
    return float(np.degrees(np.abs(corner_angles(vertices, rest.F) - corner_angles(rest.V, rest.F)).mean()))


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


def zero_area_faces(task: Task, vertices: np.ndarray) -> float:
    """How many rest faces :func:`angle_relative` leaves out."""
    return float((task.mesh.face_areas == 0).sum())


def handle(task: Task, vertices: np.ndarray) -> float:
    """Mean distance of the handle vertices to their targets over M's diagonal, in percent."""
    gap = np.linalg.norm(vertices[task.handles.index] - task.handles.target, axis=1)
    return 100 * float(gap.mean()) / task.mesh.diagonal


def flips(task: Task, vertices: np.ndarray) -> float:
    """Faces whose normal opposes the mean of their edge-neighbours' in M' and did not in M."""
    return float(new_flips(task.mesh, vertices).sum())


def self_intersections(task: Task, vertices: np.ndarray) -> float:
    """Faces that intersect others in M' and did not in M; see :mod:`sshade.contact.intersections`."""
    return float(new_crossings(task.mesh, vertices).sum())


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("volume", "%", "lower", "|V_M - V_M'| / V_M (closed meshes only)", volume),
        Metric("area", "%", "lower", "|A_M - A_M'| / A_M", area),
        Metric("edge", "%", "lower", "mean over edges of |length change| / longest rest edge", edge),
        Metric("angle", "deg", "lower", "mean over corners of |angle change|", angle),
        Metric(
            "angle_relative", "%", "lower", "mean over corners of |angle change| / rest angle", angle_relative
        ),
        Metric(
            "zero_area_faces", "count", "lower", "rest faces that angle_relative leaves out", zero_area_faces
        ),
        Metric(
            "handle", "%", "lower", "mean distance of handles to targets / diagonal", handle, needs="handles"
        ),
        Metric("flips", "count", "lower", "faces that oppose their neighbours in M' and not in M", flips),
        Metric(
            "self_intersections",
            "count",
            "lower",
            "faces that intersect others in M' and not in M",
            self_intersections,
        ),
        Metric(
            "hausdorff",
            "-",
            "lower",
            "largest distance of a vertex to the other surface, the truth in the unit sphere",
            hausdorff,
            needs="truth",
        ),
        Metric(
            "chamfer",
            "-",
            "lower",
            "mean squared distance of vertices to the other surface, both ways added, scaled as d_H",
            chamfer,
            needs="truth",
        ),
        Metric(
            "truth_distance",
            "%",
            "lower",
            "mean distance of vertices to their true places / diagonal",
            truth_distance,
            needs="truth",
        ),
        Metric(
            "truth_edge",
            "%",
            "lower",
            "mean over edges of |length - true length| / longest true edge",
            truth_edge,
            needs="truth",
        ),
        Metric(
            "truth_angle",
            "deg",
            "lower",
            "mean over corners of |angle - true angle|",
            truth_angle,
            needs="truth",
        ),
    )
}


def measure(
    task: Task, vertices: np.ndarray, *, only: Collection[str] = METRICS.keys()
) -> dict[str, float | None]:
    """Every metric of the registry that the task has what it takes for, None where it is not available.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    vertices : (n, 3) float
        M', in the numbering of the task's mesh.
    only : collection of str
        Names of the metrics; all of them unless told.
    """
    vertices = np.ascontiguousarray(vertices, dtype=np.float64)
    values = {
        name: float(metric.function(task, vertices))
        for name, metric in METRICS.items()
        if name in only and getattr(task, metric.needs, None) is not None
    }
    return {name: value if np.isfinite(value) else None for name, value in values.items()}
