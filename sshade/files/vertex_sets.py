"""Handle regions: all vertices in some boxes, moved rigidly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError

#: Greatest difference of a matrix from the identity that counts as no rotation.
IDENTITY = 1e-12


def vertices_in(V: np.ndarray, boxes: ArrayLike) -> np.ndarray:
    """Find the vertices in some axis-aligned boxes. The sides belong to the boxes.

    Parameters
    ----------
    V : (n, 3) float64
    boxes : (b, 2, 3) float64
        Lowest and highest corner of each box.

    Returns
    -------
    (k,) int64, ascending

    Raises
    ------
    InputError
        When no vertex lies in the boxes.
    """
    inside = np.zeros(len(V), dtype=bool)
    for low, high in np.asarray(boxes, dtype=np.float64):
        x, y, z = ((a <= v) & (v <= b) for a, v, b in zip(low, V.T, high, strict=True))
        inside |= x & y & z
    if not inside.any():
        raise InputError("no vertex lies in its boxes")
    return np.flatnonzero(inside)


class RigidMotion(NamedTuple):
    """Rigid motion of a group: points p move to ``R (p - c) + c + t``.

    Attributes
    ----------
    rotation : (3, 3) float64
        R.
    translation : (3,) float64
        t.
    center : (3,) float64 or "centroid", optional
        c, or the mean of the points. None stands for the origin.
    """

    rotation: np.ndarray
    translation: np.ndarray
    center: np.ndarray | str | None = None

    @property
    def turns(self) -> bool:
        """Whether the rotation differs from the identity."""
        return bool(np.abs(self.rotation - np.eye(3)).max() > IDENTITY)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Move points (k, 3)."""
        if self.center is None or not self.turns:  # a translation is exact
            return rigidly_moved(points, self.rotation, self.translation)
        center = points.mean(axis=0) if isinstance(self.center, str) else self.center
        return rigidly_moved(points - center, self.rotation, center + self.translation)


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
