"""Rigid motions of points, and the motion that fits points to others (Kabsch)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

#: Largest distance of a point from its target under a common motion, as a fraction of the points' extent.
ROUNDING = 1e-6
#: Least ratio of the second to the first singular value of points that determine a rotation. Points nearly in
#: a line have a smaller ratio and leave the rotation about the line open.
SPREAD = 0.1


def common_motion(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the rotation R and translation t that move all points (k, 3) to their targets, up to rounding.

    A translation is preferred. Return None if there is no such motion, or if the points lie nearly in a line
    and leave the rotation about the line open.
    """
    tolerance = ROUNDING * np.linalg.norm(np.ptp(source, axis=0))
    R, t = np.eye(3), (target - source).mean(axis=0)
    if _farthest(source + t, target) <= tolerance:
        return R, t
    size = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
    if len(size) < 2 or size[1] < SPREAD * size[0]:
        return None
    R, t = rigid_motion(source, target)
    return (R, t) if _farthest(source @ R.T + t, target) <= tolerance else None


def _farthest(points: np.ndarray, others: np.ndarray) -> float:
    return float(np.linalg.norm(points - others, axis=1).max())


def rigid_motion(
    source: np.ndarray, target: np.ndarray, *, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation R and translation t that minimise ``sum w_i |R s_i + t - t_i|^2``.

    Parameters
    ----------
    source, target : (k, 3) float64
        Corresponding points; k must be 1 or more. Points on a line do not determine the rotation; the result
        is the smallest rotation that fits.
    weights : (k,) float64, optional
        Positive weights w; equal by default.

    Returns
    -------
    R : (3, 3) float64
        Rotation matrix, with determinant 1.
    t : (3,) float64

    References
    ----------
    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976.
    """
    from scipy.spatial.transform import Rotation

    cs, ct = (np.average(points, axis=0, weights=weights) for points in (source, target))
    a, b = source - cs, target - ct
    if weights is not None:
        b = (weights / weights.max())[:, None] * b
    U, s, Vt = np.linalg.svd(b.T @ a)
    rank = int((s > 1e-12 * s[0]).sum())
    if rank == 0:
        R = np.eye(3)
    elif rank == 1:  # points on a line, whose direction turns about the common normal
        R = Rotation.align_vectors(U[None, :, 0], Vt[:1])[0].as_matrix()
    else:
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R, ct - R @ cs


def rigidly_moved(points: np.ndarray, rotation: ArrayLike, translation: ArrayLike) -> np.ndarray:
    """Compute R p + t for each point. The result for a point has the same bits among any other points.

    Parameters
    ----------
    points : (k, 3) float64
    rotation : (3, 3) float64
    translation : (3,) float64
    """
    columns = np.asarray(rotation, dtype=np.float64).T
    return points[:, :1] * columns[0] + points[:, 1:2] * columns[1] + points[:, 2:] * columns[2] + translation
