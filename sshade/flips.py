"""Faces turned against their surroundings."""

from __future__ import annotations

import numpy as np

from sshade.mesh import Mesh


def opposes_neighbours(mesh: Mesh) -> np.ndarray:
    """(m,) bool: the face's normal has a negative product with the sum of its edge-neighbours' normals."""
    return _opposed(mesh.face_edges, mesh.face_normals)


def new_flips(mesh: Mesh, positions: np.ndarray) -> np.ndarray:
    """(m,) bool: faces that oppose their neighbours at `positions` (n, 3) and not at rest."""
    now = _opposed(mesh.face_edges, Mesh(positions, mesh.F).face_normals)
    return now & ~opposes_neighbours(mesh) if now.any() else now


def _opposed(face_edges: np.ndarray, normals: np.ndarray) -> np.ndarray:
    around = np.empty_like(normals)
    for c in range(3):
        at_edge = np.bincount(face_edges.ravel(), np.repeat(normals[:, c], 3))
        # The sum at an edge holds the face itself, once for each of its three edges.
        around[:, c] = at_edge[face_edges].sum(axis=1) - 3 * normals[:, c]
    # On a fold the sum can cancel to rounding noise, which is no direction.
    return np.einsum("ij,ij->i", normals, around) < -1e-9
