"""Stored normals and tangents follow a surface that is deformed."""

from __future__ import annotations

import numpy as np
from numba import njit

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
    groups = int(group.max(initial=-1)) + 1
    arrays = (np.ascontiguousarray(V, dtype=np.float64) for V in (rest, posed))
    return _turns(group, F, *arrays, groups)


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


# Inlined, as a call would count the references of each array anew.


@njit(inline="always")
def _unit(x, y, z):
    length = np.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 0.0)


@njit(inline="always")
def _cross(x, y):
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@njit(inline="always")
def _between(V, i, j):
    return V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]


@njit(cache=True, nogil=True)
def _mean_normals(group, F, V, groups):
    """(k, 3) sums of the area normals of the corners of each group; its last corner of the largest area."""
    normal, greatest = np.zeros((groups, 3)), np.full(groups, -1.0)
    largest = np.full(groups, -1, dtype=np.int64)
    for f in range(len(F)):
        n = _cross(_between(V, F[f, 0], F[f, 1]), _between(V, F[f, 0], F[f, 2]))
        area = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        for c in range(3):
            g = group[f, c]
            if g >= 0:
                for i in range(3):
                    normal[g, i] += n[i]
                if area >= greatest[g]:
                    greatest[g], largest[g] = area, 3 * f + c
    return normal, largest


@njit(cache=True, nogil=True)
def _frame(normal, F, V, corner, frame):
    """Fill the orthonormal rows of a group; False where it has no normal or no median."""
    n = _unit(normal[0], normal[1], normal[2])
    f, c = corner // 3, corner % 3
    one = _between(V, F[f, c], F[f, (c + 1) % 3])
    other = _between(V, F[f, c], F[f, (c + 2) % 3])
    m = _unit(one[0] + other[0], one[1] + other[1], one[2] + other[2])
    along = m[0] * n[0] + m[1] * n[1] + m[2] * n[2]
    m = _unit(m[0] - along * n[0], m[1] - along * n[1], m[2] - along * n[2])
    w = _cross(n, m)
    for i in range(3):
        frame[0, i], frame[1, i], frame[2, i] = n[i], m[i], w[i]
    return (n[0] != 0 or n[1] != 0 or n[2] != 0) and (w[0] != 0 or w[1] != 0 or w[2] != 0)


@njit(cache=True, nogil=True)
def _turns(group, F, rest, posed, groups):
    Q = np.zeros((groups, 3, 3))
    normal, largest = _mean_normals(group, F, rest, groups)
    normal_after, _ = _mean_normals(group, F, posed, groups)
    before, after = np.empty((3, 3)), np.empty((3, 3))
    for g in range(groups):
        Q[g, 0, 0] = Q[g, 1, 1] = Q[g, 2, 2] = 1.0
        if largest[g] < 0:
            continue
        sound = _frame(normal[g], F, rest, largest[g], before)
        sound &= _frame(normal_after[g], F, posed, largest[g], after)
        if sound and (before != after).any():
            for a in range(3):
                for b in range(3):
                    Q[g, a, b] = (
                        after[0, a] * before[0, b] + after[1, a] * before[1, b] + after[2, a] * before[2, b]
                    )
    return Q
