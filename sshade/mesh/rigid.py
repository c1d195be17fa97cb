"""The rigid motion that fits one set of points to another (Kabsch)."""

from __future__ import annotations

import numpy as np


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
