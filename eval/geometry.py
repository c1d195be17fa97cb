"""Measures of meshes that metrics are made of."""

from __future__ import annotations

import numpy as np

from sshade.mesh import Mesh


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


def opposes_neighbours(mesh: Mesh) -> np.ndarray:
    """(m,) bool: the face's normal has a negative product with the sum of its edge-neighbours' normals."""
    i, j = mesh.F, mesh.F[:, [1, 2, 0]]
    keys = np.minimum(i, j) * mesh.n + np.maximum(i, j)
    _, edge_of = np.unique(keys.ravel(), return_inverse=True)
    edge_of = edge_of.reshape(-1, 3)
    normals = mesh.face_normals
    around = np.empty_like(normals)
    for c in range(3):
        at_edge = sum(np.bincount(edge_of[:, k], normals[:, c], edge_of.max() + 1) for k in range(3))
        # The sum at an edge holds the face itself, once for each of its three edges.
        around[:, c] = at_edge[edge_of].sum(axis=1) - 3 * normals[:, c]
    # On a fold the sum can cancel to rounding noise, which is no direction.
    return np.einsum("ij,ij->i", normals, around) < -1e-9
