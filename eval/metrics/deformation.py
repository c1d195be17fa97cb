"""The measures: differences between the rest mesh, the deformed mesh and the true pose.

Changes of volume, area, edges and angles follow the paper, which follows D. Baieri, F. Maggioli, Z. Laehner,
S. Melzi, E. Rodola, "Implicit-ARAP", 2024: relative area and volume error, mean edge-length change over the
longest edge, mean face-angle change.

Creases: a smooth bend of a joint and a sharp fold may have the same mean change of lengths and angles, but a
fold is visible. A handle of one vertex can pull a spike out of the surface; it changes the angles around it.

Distances between surfaces follow the isometric experiment of the paper. Both shapes are scaled so that the
ground truth fits the unit sphere: the mean of its vertices is the origin, and the largest distance is 1.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed, metric
from eval.metrics.shape import MeasuredShape, angle_between, weighted_percentile


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

    Methods also leave out needles; see :data:`sshade.mesh.faces.NO_AREA`.
    """
    return float((deformed.rest.face_areas == 0).sum())


@metric("%", "mean distance of handles to targets / diagonal", "handles")
def handle(deformed: Deformed) -> float:
    """Mean distance of the handle vertices to their targets over M's diagonal, in percent."""
    handles = deformed.handles
    gap = np.linalg.norm(deformed.shape.V[handles.index] - handles.target, axis=1)
    return 100 * float(gap.mean()) / deformed.mesh.diagonal


@metric("count", "faces that oppose their neighbours in M' and not in M")
def flips(deformed: Deformed) -> float:
    """Count inverted faces: the normal opposes the mean normal of the edge-neighbours in M', but not in M."""
    return float(deformed.flipped.sum())


@metric("count", "faces that intersect others in M' and not in M")
def self_intersections(deformed: Deformed) -> float:
    """Count faces that intersect others in M' but not in M (:mod:`eval.metrics.shape`); NaN if scrambled."""
    return np.nan if deformed.shape.is_scrambled else float(deformed.intersecting.sum())


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
    topology, handles = deformed.rest.topology, deformed.handles
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
