"""Faces turned against their surroundings."""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.mesh import Mesh


def opposes_neighbours(mesh: Mesh) -> np.ndarray:
    """(m,) bool: the face's normal has a negative product with the sum of its edge-neighbours' normals."""
    return _opposed(mesh.V, mesh.F, mesh.face_edges)


def new_flips(mesh: Mesh, positions: np.ndarray) -> np.ndarray:
    """(m,) bool: faces that oppose their neighbours at `positions` (n, 3) and not at rest.

    Raises
    ------
    InputError
        On positions that :meth:`sshade.mesh.Mesh.checked` refuses.
    """
    now = _opposed(mesh.checked(positions), mesh.F, mesh.face_edges)
    return now & ~opposes_neighbours(mesh) if now.any() else now


@njit(cache=True, nogil=True)
def _opposed(V, F, face_edges):
    normals, around = np.empty((len(F), 3)), np.zeros((face_edges.max() + 1, 3))
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
        for d in range(3):
            normals[f, d] = normal[d] / length if length > 0 else 0.0
            for side in range(3):
                around[face_edges[f, side], d] += normals[f, d]
    opposed = np.empty(len(F), dtype=np.bool_)
    for f in range(len(F)):
        i, j, k = face_edges[f, 0], face_edges[f, 1], face_edges[f, 2]
        product = 0.0
        for d in range(3):
            # The sum at an edge holds the face itself, once for each of its three edges.
            others = around[i, d] + around[j, d] + around[k, d] - 3 * normals[f, d]
            product += normals[f, d] * others
        # On a fold the sum can cancel to rounding noise, which is no direction.
        opposed[f] = product < -1e-9
    return opposed
