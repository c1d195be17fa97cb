"""The local step of as-rigid-as-possible energies: one rotation a vertex, and what follows from it.

Both energies are sums over *elements*, small sets of corners c with vectors
y_c that add up to zero:

- spokes: an edge (i, j), y_i = w_ij (p_i - p_j);
- spokes and rims: a triangle, y_k = sum over its edges kl of h_kl (p_k - p_l).

An element adds ``sum_c y_c q_c^T`` to the covariance S of each of its corners
and ``M y_c`` to the right-hand side of corner c, M being the mean of its
corners' rotations.
"""

from __future__ import annotations

from numba import njit

from sshade.solver.fitting import fit_rotations

#: The end of a range that has none.
EVERY = 2**62


@njit(cache=True, nogil=True)
def local_step(corners, Y, H, P, Q, R, first=0, end=EVERY):
    """Fit the rotations of the vertices from `first` to `end`, by default all, to positions P.

    Parameters
    ----------
    corners : (e, 2) or (e, 3) int32
        Vertices of each element; at least those that touch the vertices from `first` to `end`.
    Y : (e, 1, 3) or (e, 2, 3) float64
        y of all its corners but the last, whose y is minus their sum.
    H : (e, 1) or (e, 3) float64
        Weight of its edges 01, 12, 20.
    P : (n, 3) float64
        Deformed positions.
    Q : (n, 4) float64
        Unit quaternions: the previous rotations in, the new ones out.
    R : (n, 9) float64
        The new rotation matrices out, row by row.
    first, end : int
        Steps over ranges that cover all vertices equal one over all, to the
        last bit, and may run at the same time.

    Returns
    -------
    float
        ``sum_elements corners * sum_edges h |e'|^2 - 2 sum_i tr(R_i S_i)``: the
        energy, but for the constant that the rest edges add. Of a range, the
        part of its vertices and of the elements whose lowest vertex is in it.
    """
    end = min(end, len(P))
    R[first:end] = 0.0
    if corners.shape[1] == 3:
        energy = _triangle_covariances(corners, Y, H, P, R, first, end)
    else:
        energy = _edge_covariances(corners, Y, H, P, R, first, end)
    return energy - 2.0 * fit_rotations(R[first:end], Q[first:end])


@njit(cache=True, nogil=True)
def right_hand_side(corners, Y, R, B, first=0, end=EVERY):
    """Write the global step's right-hand side, without what held vertices add, to B (n, 3).

    To its rows from `first` to `end` only, as in :func:`local_step`.
    """
    end = min(end, len(B))
    B[first:end] = 0.0
    if corners.shape[1] == 3:
        _triangle_right_hand_side(corners, Y, R, B, first, end)
    else:
        _edge_right_hand_side(corners, Y, R, B, first, end)


@njit(cache=True, nogil=True)
def _triangle_covariances(corners, Y, H, P, S, first, end):
    energy = 0.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        ax, ay, az = P[i, 0] - P[k, 0], P[i, 1] - P[k, 1], P[i, 2] - P[k, 2]
        bx, by, bz = P[j, 0] - P[k, 0], P[j, 1] - P[k, 1], P[j, 2] - P[k, 2]
        cx, cy, cz = ax - bx, ay - by, az - bz
        if min(i, j, k) >= first:
            energy += 3.0 * (
                H[t, 0] * (cx * cx + cy * cy + cz * cz)
                + H[t, 1] * (bx * bx + by * by + bz * bz)
                + H[t, 2] * (ax * ax + ay * ay + az * az)
            )
        for c in (i, j, k):
            if first <= c < end:
                for r in range(3):
                    y, z = Y[t, 0, r], Y[t, 1, r]
                    S[c, 3 * r] += y * ax + z * bx
                    S[c, 3 * r + 1] += y * ay + z * by
                    S[c, 3 * r + 2] += y * az + z * bz
    return energy


@njit(cache=True, nogil=True)
def _edge_covariances(corners, Y, H, P, S, first, end):
    energy = 0.0
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        ax, ay, az = P[i, 0] - P[j, 0], P[i, 1] - P[j, 1], P[i, 2] - P[j, 2]
        if min(i, j) >= first:
            energy += 2.0 * H[t, 0] * (ax * ax + ay * ay + az * az)
        for c in (i, j):
            if first <= c < end:
                for r in range(3):
                    y = Y[t, 0, r]
                    S[c, 3 * r] += y * ax
                    S[c, 3 * r + 1] += y * ay
                    S[c, 3 * r + 2] += y * az
    return energy


@njit(cache=True, nogil=True)
def _triangle_right_hand_side(corners, Y, R, B, first, end):
    third = 1.0 / 3.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        for r in range(3):
            a = third * (R[i, 3 * r] + R[j, 3 * r] + R[k, 3 * r])
            b = third * (R[i, 3 * r + 1] + R[j, 3 * r + 1] + R[k, 3 * r + 1])
            c = third * (R[i, 3 * r + 2] + R[j, 3 * r + 2] + R[k, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2]
            at_j = a * Y[t, 1, 0] + b * Y[t, 1, 1] + c * Y[t, 1, 2]
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] += at_j
            if first <= k < end:
                B[k, r] -= at_i + at_j


@njit(cache=True, nogil=True)
def _edge_right_hand_side(corners, Y, R, B, first, end):
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        for r in range(3):
            a = 0.5 * (R[i, 3 * r] + R[j, 3 * r])
            b = 0.5 * (R[i, 3 * r + 1] + R[j, 3 * r + 1])
            c = 0.5 * (R[i, 3 * r + 2] + R[j, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2]
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] -= at_i
