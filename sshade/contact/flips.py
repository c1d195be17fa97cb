"""Faces turned against their surroundings."""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.mesh.mesh import Mesh


def opposes_neighbours(mesh: Mesh) -> np.ndarray:
    """(m,) bool: the face's normal has a negative product with the sum of its edge-neighbours' normals."""
    return _opposed(mesh.V, mesh.F, mesh.face_edges, np.ones(mesh.m, dtype=np.bool_))


def new_flips(mesh: Mesh, positions: np.ndarray, *, among: np.ndarray | None = None) -> np.ndarray:
    """(m,) bool: faces that oppose their neighbours at `positions` (n, 3) and not at rest.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    positions : (n, 3) float64
    among : (m,) bool, optional
        Only these faces, and those at an edge of theirs.

    Raises
    ------
    InputError
        On positions that :meth:`sshade.mesh.mesh.Mesh.checked` refuses.
    """
    among = np.ones(mesh.m, dtype=np.bool_) if among is None else among
    now = _opposed(mesh.checked(positions), mesh.F, mesh.face_edges, among)
    return now & ~_opposed(mesh.V, mesh.F, mesh.face_edges, now) if now.any() else now


@njit(cache=True, nogil=True)
def _opposed(V, F, face_edges, among):
    """Of the faces among these, and those at an edge of theirs."""
    near = _at_edges_of(face_edges, among)
    concerned = _at_edges_of(face_edges, near)
    normals, around = np.empty((len(F), 3)), np.zeros((face_edges.max() + 1, 3))
    for f in range(len(F)):
        if not concerned[f]:
            continue
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
        for d in range(3):
            normals[f, d] = normal[d] / length if length > 0 else 0.0
            for side in range(3):
                around[face_edges[f, side], d] += normals[f, d]
    opposed = np.zeros(len(F), dtype=np.bool_)
    for f in range(len(F)):
        if not near[f]:
            continue
        i, j, k = face_edges[f, 0], face_edges[f, 1], face_edges[f, 2]
        product = 0.0
        for d in range(3):
            # The sum at an edge holds the face itself, once for each of its three edges.
            others = around[i, d] + around[j, d] + around[k, d] - 3 * normals[f, d]
            product += normals[f, d] * others
        # On a fold the sum can cancel to rounding noise, which is no direction.
        opposed[f] = product < -1e-9
    return opposed


@njit(cache=True, nogil=True)
def _at_edges_of(face_edges, faces):
    """(m,) bool: these faces, and those at an edge of theirs."""
    edges = np.zeros(face_edges.max() + 1, dtype=np.bool_)
    for f in range(len(faces)):
        if faces[f]:
            for side in range(3):
                edges[face_edges[f, side]] = True
    found = np.empty(len(faces), dtype=np.bool_)
    for f in range(len(faces)):
        found[f] = edges[face_edges[f, 0]] | edges[face_edges[f, 1]] | edges[face_edges[f, 2]]
    return found
