"""Measures of meshes that metrics are made of."""

from __future__ import annotations

import numpy as np

from sshade.mesh.adjacency import sides_by_edge


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


def dihedral_edges(F: np.ndarray, n: int) -> np.ndarray:
    """(d, 4) corners i, j, k, o of the two faces ijk and jio at each edge ij that has a dihedral angle.

    Edges of the boundary, of more than two faces, or of faces wound against each other have none.

    Parameters
    ----------
    F : (m, 3) int
    n : int
        Number of vertices.
    """
    sides = sides_by_edge(F, n)
    first = sides.start[:-1][sides.faces == 2]
    one, two = (np.divmod(sides.side[first + k], 3) for k in range(2))
    i, j, k = (F[one[0], (one[1] + c) % 3] for c in range(3))
    begin, apex = F[two[0], two[1]], F[two[0], (two[1] + 2) % 3]
    return np.stack([i, j, k, apex], axis=1)[begin == j]


def dihedral_angles(V: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(d,) signed angle between the normals of the faces at each of :func:`dihedral_edges`, in radians.

    Zero where they are flat, positive where the surface is convex; atan2 keeps its digits at 0 and pi.
    """
    i, j, k, o = (V[corners[:, c]] for c in range(4))
    edge = j - i
    first, second = np.cross(edge, k - i), np.cross(o - i, edge)
    sine = np.einsum("ij,ij->i", np.cross(first, second), edge)
    cosine = np.einsum("ij,ij->i", first, second) * np.linalg.norm(edge, axis=1)
    return np.arctan2(sine, cosine)


def weighted_percentile(values: np.ndarray, weights: np.ndarray, percent: float) -> float:
    """The smallest value that at least `percent` of the weight does not exceed; NaN of nothing."""
    if not len(values):
        return np.nan
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order[min(np.searchsorted(share, percent / 100 * share[-1]), len(order) - 1)]])
