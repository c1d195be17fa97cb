"""Handle regions: all vertices in some boxes, moved rigidly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sshade.errors import InputError


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
        inside |= ((low <= V) & (high >= V)).all(axis=1)
    if not inside.any():
        raise InputError("no vertex lies in its boxes")
    return np.flatnonzero(inside)


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
