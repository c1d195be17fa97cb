"""Stored normals and tangents follow a surface that is deformed."""

from __future__ import annotations

import numpy as np

from sshade.mesh.seams import same_rows


def turns(group: np.ndarray, F: np.ndarray, rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """How the surface turns at each group of corners of its triangles.

    The frame of a group is its area-weighted mean normal and, perpendicular to it, the median of its
    largest triangle through the corner. So a stored normal that is the mean normal stays that, and one
    that an artist set keeps its place to the surface. Where nothing moves the rotation is exactly 1,
    and so it is where a group has no area.

    Parameters
    ----------
    group : (m, 3) int
        Of each corner, from 0, those with one normal in common; -1 for none.
    F : (m, 3) int
    rest, posed : (n, 3) float64
        Positions before and after.

    Returns
    -------
    (k, 3, 3) float64
    """
    corner = np.flatnonzero(group.ravel() >= 0)
    own, face = group.ravel()[corner], corner // 3
    groups = int(group.max(initial=-1)) + 1
    area = np.linalg.norm(_cross(F, rest), axis=1)[face]
    order = np.lexsort([area, own])
    largest = corner[order[np.append(own[order][1:] != own[order][:-1], True)]] if len(own) else corner
    Q = np.tile(np.eye(3), (groups, 1, 1))
    before, after = (_frames(own, face, largest, F, V) for V in (rest, posed))
    sound = np.linalg.norm(before, axis=2).all(axis=1) & np.linalg.norm(after, axis=2).all(axis=1)
    turned = sound & (before != after).any(axis=(1, 2))
    Q[turned] = np.einsum("kia,kib->kab", after[turned], before[turned])
    return Q


def vertex_turns(N: np.ndarray, F: np.ndarray, rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """The same at each vertex with a normal of its own (n, 3); along a smooth seam both sides turn alike.

    Returns
    -------
    (n, 3, 3) float64
    """
    group = same_rows(np.column_stack([rest, posed, N]))
    Q = np.tile(np.eye(3), (int(group.max(initial=-1)) + 1, 1, 1))
    known = turns(group[F], F, rest, posed)  # ends with the last group that has a face
    Q[: len(known)] = known
    return Q[group]


def _cross(F: np.ndarray, V: np.ndarray) -> np.ndarray:
    a, b, c = (np.ascontiguousarray(V[F[:, i]].T) for i in range(3))
    return np.cross(b - a, c - a, axis=0).T


def _frames(
    own: np.ndarray, face: np.ndarray, largest: np.ndarray, F: np.ndarray, V: np.ndarray
) -> np.ndarray:
    """(k, 3, 3) orthonormal rows of each group; rows of zeros where it has no normal or no median.

    `own` are the groups of corners of `face`, `largest` the corner of each group that gives its median.
    """
    normal = _unit(np.stack([np.bincount(own, x[face]) for x in _cross(F, V).T], axis=1))
    median = np.zeros_like(normal)
    median[np.unique(own)] = _unit(V[F[largest // 3]].sum(axis=1) - 3.0 * V[F.ravel()[largest]])
    median = _unit(median - np.einsum("ki,ki->k", median, normal)[:, None] * normal)
    return np.stack([normal, median, np.cross(normal, median)], axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
