"""Arrays of ids: which numbers are in an array, at which position, and which numbers have a label."""

from __future__ import annotations

import numpy as np


def flagged(ids: np.ndarray, n: int) -> np.ndarray:
    """Return (n,) bool: the numbers in [0, n) that are in `ids`, an array of any shape."""
    flags = np.zeros(n, dtype=bool)
    flags[ids] = True
    return flags


def numbered(ids: np.ndarray, n: int) -> np.ndarray:
    """Return (n,) int64: for each number in [0, n) its position in `ids` (k,), or -1 if it is not there."""
    position = np.full(n, -1)
    position[ids] = np.arange(len(ids))
    return position


def members(labels: np.ndarray, count: int) -> list[np.ndarray]:
    """For each label in [0, count), return the positions (p,) int64 that have it, in ascending order."""
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.cumsum(np.bincount(labels, minlength=count)))[:count]
