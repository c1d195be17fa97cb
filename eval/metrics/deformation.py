"""Differences between the rest mesh and the deformed mesh.

Errors follow the paper, which follows D. Baieri, F. Maggioli, Z. Laehner,
S. Melzi, E. Rodola, "Implicit-ARAP", 2024: relative area and volume error, mean
edge-length change over the longest edge, mean face-angle change.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric


@metric("%", "|V_M - V_M'| / V_M (closed meshes only)")
def volume(deformed: Deformed) -> float:
    """Relative change of the enclosed volume in percent; NaN unless M is closed and oriented."""
    rest = deformed.rest.volume
    if not (deformed.mesh.is_closed and deformed.mesh.is_oriented) or rest == 0:
        return np.nan
    return 100 * abs(deformed.shape.volume - rest) / abs(rest)


@metric("%", "|A_M - A_M'| / A_M")
def area(deformed: Deformed) -> float:
    """Relative change of the total surface area in percent."""
    return 100 * abs(deformed.shape.area - deformed.rest.area) / deformed.rest.area


@metric("%", "mean over edges of |length change| / longest rest edge")
def edge(deformed: Deformed) -> float:
    """Mean absolute change of an edge's length over the longest rest edge, in percent (EL)."""
    before = deformed.rest.edge_lengths
    return 100 * float(np.abs(deformed.shape.edge_lengths - before).mean()) / float(before.max())


@metric("deg", "mean over corners of |angle change|")
def angle(deformed: Deformed) -> float:
    """Mean absolute change of a corner's angle in degrees (FA, as the paper's table prints it)."""
    return float(np.degrees(np.abs(deformed.shape.corner_angles - deformed.rest.corner_angles).mean()))


@metric("%", "mean over corners of |angle change| / rest angle")
def angle_relative(deformed: Deformed) -> float:
    """Return the mean change of a corner's angle over its rest angle, in percent: the paper's formula.

    Rest faces without area would divide by an angle of zero. They are excluded here and counted by
    :func:`zero_area_faces`. NaN if all faces are excluded.
    """
    before = deformed.rest.corner_angles
    # A needle's corner can round to zero although the area does not.
    usable = (before > 0) & (deformed.rest.face_areas > 0)[:, None]
    if not usable.any():
        return np.nan
    return 100 * float((np.abs(deformed.shape.corner_angles - before)[usable] / before[usable]).mean())


@metric("count", "rest faces that angle_relative leaves out")
def zero_area_faces(deformed: Deformed) -> float:
    """Return the number of rest faces that :func:`angle_relative` excludes: their area is exactly zero.

    Methods also leave out needles; see :data:`sshade.mesh.areas.NO_AREA`.
    """
    return float((deformed.rest.face_areas == 0).sum())


@metric("%", "mean distance of handles to targets / diagonal", "handles")
def handle(deformed: Deformed) -> float:
    """Mean distance of the handle vertices to their targets over M's diagonal, in percent."""
    handles = deformed.task.handles
    gap = np.linalg.norm(deformed.shape.V[handles.index] - handles.target, axis=1)
    return 100 * float(gap.mean()) / deformed.mesh.diagonal


@metric("count", "faces that oppose their neighbours in M' and not in M")
def flips(deformed: Deformed) -> float:
    """Count inverted faces: the normal opposes the mean normal of the edge-neighbours in M', but not in M."""
    return float(deformed.flipped.sum())


@metric("count", "faces that intersect others in M' and not in M")
def self_intersections(deformed: Deformed) -> float:
    """Count faces that intersect other faces in M' but not in M; see :mod:`eval.metrics.intersections`."""
    return float(deformed.intersecting.sum())
