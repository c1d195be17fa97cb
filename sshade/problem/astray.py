"""Handles whose targets contradict the targets of their neighbours, as after an exchange of two rows."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

#: Number of nearest handles that a handle is compared with, and how many of them must agree with it.
NEIGHBOURS, AGREEING = 8, 2
#: Growth of the distance between two handles from which on they disagree, as a multiple of the growth around
#: their neighbours. True poses of bodies and animals stay below 1.8.
STRETCH = 2.5


def astray(rest: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Find handles that go far from where their neighbours go.

    Two handles agree if their distance grows by less than :data:`STRETCH`. Where parts of a surface move
    apart, handles have neighbours on their own side, which agree.

    Parameters
    ----------
    rest, target : (k, 3) float64
        Positions of handles at different places.

    Returns
    -------
    (a,) int64
        Handles with fewer than :data:`AGREEING` agreeing neighbours; none if there are too few handles.
    """
    if len(rest) <= NEIGHBOURS:
        return np.zeros(0, dtype=np.int64)
    distance, near = cKDTree(rest).query(rest, k=NEIGHBOURS + 1)
    apart = np.linalg.norm(target[:, None] - target[near[:, 1:]], axis=2)
    growth = np.sort(apart / np.maximum(distance[:, 1:], np.finfo(np.float64).tiny), axis=1)[:, AGREEING - 1]
    around = np.median(growth[near[:, 1:]], axis=1)
    return np.flatnonzero(growth > STRETCH * np.maximum(around, 1.0))
