"""Differences between the rest mesh and the deformed mesh.

Errors follow the paper, which follows D. Baieri, F. Maggioli, Z. Laehner,
S. Melzi, E. Rodola, "Implicit-ARAP", 2024: relative area and volume error, mean
edge-length change over the longest edge, mean face-angle change.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import MeasuredShape, weighted_percentile


@metric("%", "|V_M - V_M'| / V_M (closed meshes only)")
def volume(deformed: Deformed) -> float:
    """Relative change of the enclosed volume in percent; NaN unless M is closed and oriented."""
    return volume_change(deformed, deformed.rest)


def volume_change(deformed: Deformed, other: MeasuredShape) -> float:
    """Return the difference of the volumes of M' and of another shape of M, in percent of the latter."""
    if not (deformed.mesh.is_closed and deformed.mesh.is_oriented) or other.volume == 0:
        return np.nan
    return 100 * abs(deformed.shape.volume - other.volume) / abs(other.volume)


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


#: Smallest singular value of a face that does not count as collapsed.
COLLAPSED = 0.1


@metric("-", "mean over area of D = (s1^2 + s2^2 + 1/s1^2 + 1/s2^2) / 2 - 2")
def distortion(deformed: Deformed) -> float:
    """Return the area-weighted mean of D over the faces of M; infinite if a face has lost its area."""
    D, area = _with_area(deformed)
    return float((D * area).sum() / area.sum()) if len(D) else np.nan


@metric("-", "D that 95 % of the area does not exceed")
def distortion_95(deformed: Deformed) -> float:
    """Return the 95th percentile of D by area."""
    return weighted_percentile(*_with_area(deformed), 95.0)


@metric("-", "D that 99 % of the area does not exceed")
def distortion_99(deformed: Deformed) -> float:
    """Return the 99th percentile of D by area."""
    return weighted_percentile(*_with_area(deformed), 99.0)


@metric("-", "largest D of a face")
def distortion_max(deformed: Deformed) -> float:
    """Return the largest D of a face; infinite if a face has lost its area."""
    D, _ = _with_area(deformed)
    return float(D.max()) if len(D) else np.nan


@metric("count", f"faces with s2 < {COLLAPSED}, or flipped")
def collapsed(deformed: Deformed) -> float:
    """Count faces of M that are inverted, or shrunk to less than :data:`COLLAPSED` in some direction."""
    _, s2 = deformed.singular_values
    return float(((s2 < COLLAPSED) | deformed.flipped).sum())


def _with_area(deformed: Deformed) -> tuple[np.ndarray, np.ndarray]:
    """Return D and the rest area of all faces with an area at rest."""
    area = deformed.rest.face_areas
    has_area = area > 0
    return deformed.dirichlet[has_area], area[has_area]
