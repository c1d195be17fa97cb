"""Faces turned against their surroundings."""

from __future__ import annotations

import numpy as np

from sshade.mesh import Mesh


def opposes_neighbours(mesh: Mesh) -> np.ndarray:
    """(m,) bool: the face's normal has a negative product with the sum of its edge-neighbours' normals."""
    i, j = mesh.F, mesh.F[:, [1, 2, 0]]
    keys = np.minimum(i, j) * mesh.n + np.maximum(i, j)
    _, edge_of = np.unique(keys.ravel(), return_inverse=True)
    edge_of = edge_of.reshape(-1, 3)
    normals = mesh.face_normals
    around = np.empty_like(normals)
    for c in range(3):
        at_edge = np.bincount(edge_of.ravel(), np.repeat(normals[:, c], 3))
        # The sum at an edge holds the face itself, once for each of its three edges.
        around[:, c] = at_edge[edge_of].sum(axis=1) - 3 * normals[:, c]
    # On a fold the sum can cancel to rounding noise, which is no direction.
    return np.einsum("ij,ij->i", normals, around) < -1e-9


def new_flips(mesh: Mesh, positions: np.ndarray) -> np.ndarray:
    """(m,) bool: faces that oppose their neighbours at `positions` (n, 3) and not at rest."""
    now = opposes_neighbours(Mesh(positions, mesh.F))
    return now & ~opposes_neighbours(mesh) if now.any() else now
