"""Rigid motions and similarities of points, and the motion that fits points to others (Kabsch)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError

#: Largest distance of a point from its target under a common motion, as a fraction of the points' extent.
ROUNDING = 1e-6
#: Least ratio of the second to the first singular value of points that determine a rotation. Points nearly in
#: a line have a smaller ratio and leave the rotation about the line open.
SPREAD = 0.1
#: Greatest difference of a matrix from the identity that counts as no rotation.
IDENTITY = 1e-12


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


class Similarity(NamedTuple):
    """Motion of a group: points p move to ``s R (p - c) + c + t``.

    Attributes
    ----------
    rotation : (3, 3) float64
        R.
    translation : (3,) float64
        t.
    center : (3,) float64 or "centroid", optional
        c, or the mean of the places of the points, each place once. None stands for the origin.
    scale : float
        s, above 0.
    """

    rotation: np.ndarray
    translation: np.ndarray
    center: np.ndarray | str | None = None
    scale: float = 1.0

    @property
    def is_translation(self) -> bool:
        """Whether the motion neither turns nor scales."""
        return bool(np.abs(self.rotation - np.eye(3)).max() <= IDENTITY) and self.scale == 1

    def partway(self, amount: float) -> Similarity:
        """Return the motion with `amount` times the angle, the translation and the change of the scale.

        Raises
        ------
        InputError
            When the scale would be 0 or less.
        """
        if amount == 1:
            return self
        scale = 1 + amount * (self.scale - 1)
        if scale <= 0:
            raise InputError(
                f"the scale {self.scale:g} cannot be exceeded {amount:g} times; nothing would be left"
            )
        rotation = rotations_partway(self.rotation[None], amount)[0]
        return Similarity(rotation, amount * self.translation, self.center, scale)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Move points (k, 3)."""
        if self.center is None or self.is_translation:  # a translation is exact
            return rigidly_moved(points, self.scale * self.rotation, self.translation)
        center = np.unique(points, axis=0).mean(axis=0) if isinstance(self.center, str) else self.center
        return rigidly_moved(points - center, self.scale * self.rotation, center + self.translation)


def rotations_partway(R: np.ndarray, amount: float) -> np.ndarray:
    """Return rotations (k, 3, 3) with the same axes and `amount` times the angles."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(amount * Rotation.from_matrix(R).as_rotvec()).as_matrix()


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
