"""Turn stored normals and tangents with a deformed surface."""

from __future__ import annotations

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.mesh.places import same_rows

#: Largest difference of the coordinates of two unit normals of one place that are one normal, rounded: 0.1
#: degrees, or three decimals.
SMOOTH = 2e-3
#: Cosine above which a stored normal is the mean normal, rounded: 0.08 degrees.
MEAN = 1 - 1e-6
#: Largest number of normals of one place that are compared with :data:`SMOOTH`; further ones must be equal.
NORMALS = 16


def turns(group: np.ndarray, N: np.ndarray, F: np.ndarray, rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """Compute the rotation of the surface at each group of corners of its triangles.

    The frame of a group consists of its area-weighted mean normal and of the median of its largest
    triangle, projected perpendicular to that normal. A stored normal that equals the mean normal
    therefore stays the mean normal, and a normal that an artist set keeps its angle to the surface. The
    rotation is exactly the identity where nothing moves, or where a group has no area. If the stored normal
    is not the mean normal, triangles whose normals oppose it are turned around first, as in meshes with both
    sides of each triangle.

    Parameters
    ----------
    group : (m, 3) int
        Group of each corner, counted from 0; corners of a group share a normal. -1 for no group.
    N : (k, 3) float64
        Stored normal of each group.
    F : (m, 3) int
    rest, posed : (n, 3) float64
        Positions before and after the deformation.

    Returns
    -------
    (k, 3, 3) float64
    """
    return _turns(group, F, *(np.ascontiguousarray(rows, dtype=np.float64) for rows in (N, rest, posed)))


def turned(Q: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Turn normals (k, 3) by rotations (k, 3, 3). Numbers that stay keep their bits, such as -0.0 and NaN."""
    new = np.einsum("kij,kj->ki", Q, N)
    return np.where((new == N) | np.isnan(N).any(axis=1, keepdims=True), N, new)


def vertex_turns(N: np.ndarray, F: np.ndarray, rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """Compute the rotation of the surface at each vertex; both sides of a smooth seam turn alike.

    Parameters
    ----------
    N : (n, 3) float64
        Normals at the vertices.
    F, rest, posed
        See :func:`turns`.

    Returns
    -------
    (n, 3, 3) float64
    """
    group, one = smooth_groups(posed, N)
    return turns(group[F], N[one], F, rest, posed)[group]


def smooth_groups(P: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Group normals N (p, 3) at positions P (p, 3): those of one place that are equal up to rounding.

    Returns
    -------
    group : (p,) int64
        Group of each normal, counted from 0.
    one : (k,) int64
        A member of each group.
    """
    with np.errstate(invalid="ignore"):  # a normal may be zero or NaN
        unit = N / np.linalg.norm(N, axis=1, keepdims=True)
    place, first, left = same_rows(P), np.full(len(P), -1), np.arange(len(P))
    for _ in range(NORMALS):
        leader = np.full(len(P), -1)
        leader[place[left[::-1]]] = left[::-1]
        nearest = leader[place[left]]
        same = (nearest == left) | (np.abs(unit[left] - unit[nearest]) <= SMOOTH).all(axis=1)
        first[left[same]] = nearest[same]
        left = left[~same]
        if not len(left):
            break
    else:
        rows = same_rows(np.column_stack([place[left], N[left]]))
        _, equal = np.unique(rows, return_index=True)
        first[left] = left[equal[rows]]
    leads = first == np.arange(len(first))
    return (np.cumsum(leads) - 1)[first], np.flatnonzero(leads)


# The helpers are inlined, because each call would count references to the arrays.


@subroutine(inline="always")
def _unit(x, y, z):
    length = np.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 0.0)


@subroutine(inline="always")
def _cross(x, y):
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@subroutine(inline="always")
def _between(V, i, j):
    return V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]


@subroutine(inline="always")
def _cosine(x, y):
    size = (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    return (x[0] * y[0] + x[1] * y[1] + x[2] * y[2]) / np.sqrt(size) if size > 0 else 0.0


@subroutine
def _mean_normals(group, F, N, rest, posed):
    """Return the sums (k, 3) of the area normals of groups at rest and posed, and their largest corners.

    The largest corner is the last one in a triangle of largest area at rest.
    """
    before, after, greatest = np.zeros(N.shape), np.zeros(N.shape), np.full(len(N), -1.0)
    largest, sided = np.full(len(N), -1, dtype=np.int64), np.zeros(len(N), dtype=np.bool_)
    for f in range(len(F)):
        n = _cross(_between(rest, F[f, 0], F[f, 1]), _between(rest, F[f, 0], F[f, 2]))
        area = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        for c in range(3):
            g = group[f, c]
            if g >= 0:
                side = -1.0 if n[0] * N[g, 0] + n[1] * N[g, 1] + n[2] * N[g, 2] < 0 else 1.0
                for i in range(3):
                    before[g, i] += n[i]
                    after[g, i] += side * n[i]  # for now, at rest
                if area >= greatest[g]:
                    greatest[g], largest[g] = area, 3 * f + c
    for g in range(len(N)):
        # Both sides of a triangle leave a sum that is zero, or rounding.
        sided[g] = _cosine(before[g], N[g]) < MEAN or (before[g] ** 2).sum() < 1e-12 * (after[g] ** 2).sum()
        for i in range(3):
            before[g, i] = after[g, i] if sided[g] else before[g, i]
            after[g, i] = 0.0
    for f in range(len(F)):
        n = _cross(_between(rest, F[f, 0], F[f, 1]), _between(rest, F[f, 0], F[f, 2]))
        m = _cross(_between(posed, F[f, 0], F[f, 1]), _between(posed, F[f, 0], F[f, 2]))
        for c in range(3):
            g = group[f, c]
            if g >= 0:
                opposes = sided[g] and n[0] * N[g, 0] + n[1] * N[g, 1] + n[2] * N[g, 2] < 0
                for i in range(3):
                    after[g, i] += -m[i] if opposes else m[i]
    return before, after, largest


@subroutine
def _frame(normal, F, V, corner, frame):
    """Write the orthonormal rows of a group to `frame`; return False if it has no normal or no median."""
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


@kernel
def _turns(group, F, N, rest, posed):
    Q = np.zeros((len(N), 3, 3))
    normal, normal_after, largest = _mean_normals(group, F, N, rest, posed)
    before, after = np.empty((3, 3)), np.empty((3, 3))
    for g in range(len(N)):
        Q[g, 0, 0] = Q[g, 1, 1] = Q[g, 2, 2] = 1.0
        if largest[g] < 0:
            continue
        sound = _frame(normal[g], F, rest, largest[g], before)
        sound &= _frame(normal_after[g], F, posed, largest[g], after)
        if sound and (before != after).any():
            for a in range(3):
                for b in range(3):
                    total = after[0, a] * before[0, b] + after[1, a] * before[1, b]
                    Q[g, a, b] = total + after[2, a] * before[2, b]
    return Q
