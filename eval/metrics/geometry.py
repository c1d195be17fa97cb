"""Measures of meshes that metrics are made of."""

from __future__ import annotations

import numpy as np


def edge_lengths(V: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(e,) lengths of the edges (e, 2)."""
    return np.linalg.norm(V[edges[:, 0]] - V[edges[:, 1]], axis=1)


def corner_angles(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(m, 3) angle at each corner in radians, zero where an edge has no length.

    atan2 of cross and dot product: unlike arccos it keeps its digits at 0 and pi.
    """
    angles = np.empty(F.shape)
    for i in range(3):
        a = V[F[:, (i + 1) % 3]] - V[F[:, i]]
        b = V[F[:, (i + 2) % 3]] - V[F[:, i]]
        angles[:, i] = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    return angles
