"""The local step of as-rigid-as-possible energies: one rotation a vertex, and what follows from it.

Both energies are sums over *elements*, small sets of corners c with vectors
y_c that add up to zero:

- spokes: an edge (i, j), y_i = w_ij (p_i - p_j);
- spokes and rims: a triangle, y_k = sum over its edges kl of h_kl (p_k - p_l).

An element adds ``sum_c y_c q_c^T`` to the covariance S of each of its corners
and ``M y_c`` to the right-hand side of corner c, M being the mean of its
corners' rotations. Rotations are kept as unit quaternions (w, x, y, z): they
stay orthogonal over any number of warm-started updates.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: The end of a range that has none.
EVERY = 2**62
#: A Newton step shorter than this (radians) leaves an error of its cube, below rounding.
LAST_STEP = 1e-6
#: Beyond this step (radians), or this many, the warm start is no use.
LONGEST_STEP = 0.5
MOST_STEPS = 6
#: Smallest accepted det H / (tr H)^3: below it the maximum is nearly undetermined.
SMALLEST_DETERMINANT = 1e-10
#: Eigenvalues this close (relative) to the largest count as equal to it.
SAME_EIGENVALUE = 1e-13
JACOBI_SWEEPS = 30


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


@njit(cache=True, nogil=True)
def fit_rotations(S, Q):
    """Rotate each cell as well as possible: R_i maximises tr(R S_i) over the rotations.

    Equals ``V diag(1, 1, det(V U^T)) U^T`` of the singular value decomposition
    ``S = U diag(s) V^T``. Newton's method on the rotation group, started from
    the previous rotation: with T = R S, the step is (tr T - sym T)^-1 times the
    axial vector of T, and its error is the cube of its length. A stationary
    point at which that matrix is positive definite is the global maximum, so
    what Newton returns is certain; where it is not, or the steps are long, the
    largest eigenvector of Horn's 4 x 4 matrix decides. Where S leaves the
    rotation open (rank one, or zero) the previous one turns by the least that
    makes it a maximiser.

    Parameters
    ----------
    S : (n, 9) float64
        Covariances ``sum w e e'^T`` (rest times deformed), row by row, of any
        scale; replaced by the rotation matrices.
    Q : (n, 4) float64
        Unit quaternions, replaced.

    Returns
    -------
    float
        ``sum_i tr(R_i S_i)``.

    References
    ----------
    B. K. P. Horn, "Closed-form solution of absolute orientation using unit
    quaternions", 1987. T. Kugelstadt, D. Koschier, J. Bender, "Fast corotated
    FEM using operator splitting", 2018 (the warm-started Newton iteration).
    """
    C = np.empty(9)
    A, E = np.empty((4, 4)), np.empty((4, 4))
    total = 0.0
    for i in range(len(S)):
        R = S[i]
        size = 0.0
        for r in range(9):
            size = max(size, abs(R[r]))
        if size > 0.0:
            for r in range(9):
                C[r] = R[r] / size
            if not _newton(C, Q[i], R):
                _largest_eigenvector(C, Q[i], A, E)
        else:
            C[:] = 0.0
        _matrix(Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3], R)
        trace = 0.0
        for r in range(3):
            trace += R[3 * r] * C[r] + R[3 * r + 1] * C[3 + r] + R[3 * r + 2] * C[6 + r]
        total += size * trace
    return total


@njit(cache=True, nogil=True)
def _newton(C, q, R):
    """Improve q in place; False, with q untouched, where that is not certain to reach the maximum."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    for _ in range(MOST_STEPS):
        _matrix(w, x, y, z, R)
        t00 = R[0] * C[0] + R[1] * C[3] + R[2] * C[6]
        t01 = R[0] * C[1] + R[1] * C[4] + R[2] * C[7]
        t02 = R[0] * C[2] + R[1] * C[5] + R[2] * C[8]
        t10 = R[3] * C[0] + R[4] * C[3] + R[5] * C[6]
        t11 = R[3] * C[1] + R[4] * C[4] + R[5] * C[7]
        t12 = R[3] * C[2] + R[4] * C[5] + R[5] * C[8]
        t20 = R[6] * C[0] + R[7] * C[3] + R[8] * C[6]
        t21 = R[6] * C[1] + R[7] * C[4] + R[8] * C[7]
        t22 = R[6] * C[2] + R[7] * C[5] + R[8] * C[8]
        gx, gy, gz = t12 - t21, t20 - t02, t01 - t10
        h00, h11, h22 = t11 + t22, t00 + t22, t00 + t11
        h01, h02, h12 = -0.5 * (t01 + t10), -0.5 * (t02 + t20), -0.5 * (t12 + t21)
        # The inverse by cofactors: Sylvester's three minors come with it.
        c00, c01, c02 = h11 * h22 - h12 * h12, h02 * h12 - h01 * h22, h01 * h12 - h02 * h11
        c11, c12, c22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
        determinant = h00 * c00 + h01 * c01 + h02 * c02
        trace = h00 + h11 + h22
        if not (h00 > 0.0 and c22 > 0.0 and determinant > SMALLEST_DETERMINANT * trace * trace * trace):
            return False
        half = 0.5 / determinant
        ax = half * (c00 * gx + c01 * gy + c02 * gz)
        ay = half * (c01 * gx + c11 * gy + c12 * gz)
        az = half * (c02 * gx + c12 * gy + c22 * gz)
        step = 4.0 * (ax * ax + ay * ay + az * az)
        if step > LONGEST_STEP * LONGEST_STEP:
            return False
        w, x, y, z = (
            w - ax * x - ay * y - az * z,
            x + ax * w + ay * z - az * y,
            y + ay * w + az * x - ax * z,
            z + az * w + ax * y - ay * x,
        )
        norm = np.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        if step < LAST_STEP * LAST_STEP:
            q[0], q[1], q[2], q[3] = w, x, y, z
            return True
    return False


@njit(cache=True, nogil=True)
def _matrix(w, x, y, z, R):
    """Write the rotation matrix of a unit quaternion, row by row."""
    R[0] = 1.0 - 2.0 * (y * y + z * z)
    R[1] = 2.0 * (x * y - w * z)
    R[2] = 2.0 * (x * z + w * y)
    R[3] = 2.0 * (x * y + w * z)
    R[4] = 1.0 - 2.0 * (x * x + z * z)
    R[5] = 2.0 * (y * z - w * x)
    R[6] = 2.0 * (x * z - w * y)
    R[7] = 2.0 * (y * z + w * x)
    R[8] = 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True, nogil=True)
def _largest_eigenvector(C, q, A, E):
    """Replace q by the maximiser of tr(R C) that is nearest to it: Horn's matrix, cyclic Jacobi."""
    A[0, 0] = C[0] + C[4] + C[8]
    A[1, 1] = C[0] - C[4] - C[8]
    A[2, 2] = C[4] - C[0] - C[8]
    A[3, 3] = C[8] - C[0] - C[4]
    A[0, 1] = A[1, 0] = C[5] - C[7]
    A[0, 2] = A[2, 0] = C[6] - C[2]
    A[0, 3] = A[3, 0] = C[1] - C[3]
    A[1, 2] = A[2, 1] = C[1] + C[3]
    A[1, 3] = A[3, 1] = C[6] + C[2]
    A[2, 3] = A[3, 2] = C[5] + C[7]
    E[:] = 0.0
    for a in range(4):
        E[a, a] = 1.0
    for _ in range(JACOBI_SWEEPS):
        rotated = False
        for a in range(3):
            for b in range(a + 1, 4):
                rotated |= _jacobi(A, E, a, b)
        if not rotated:
            break
    top, size = A[0, 0], 0.0
    for a in range(4):
        top, size = max(top, A[a, a]), max(size, abs(A[a, a]))
    # Project q onto the eigenspace of the largest eigenvalue; one dimension unless S is degenerate.
    px = py = pz = pw = 0.0
    for a in range(4):
        if A[a, a] >= top - SAME_EIGENVALUE * size:
            dot = E[0, a] * q[0] + E[1, a] * q[1] + E[2, a] * q[2] + E[3, a] * q[3]
            if A[a, a] == top and abs(dot) < 1e-8:  # orthogonal to q: either sign is as near
                dot = 1e-8
            pw, px, py, pz = pw + dot * E[0, a], px + dot * E[1, a], py + dot * E[2, a], pz + dot * E[3, a]
    norm = 1.0 / np.sqrt(pw * pw + px * px + py * py + pz * pz)
    q[0], q[1], q[2], q[3] = norm * pw, norm * px, norm * py, norm * pz


@njit(cache=True, nogil=True)
def _jacobi(A, E, a, b):
    """One rotation that annihilates A[a, b]; False where it is negligible already."""
    off = A[a, b]
    if abs(off) <= 1e-17 * (abs(A[a, a]) + abs(A[b, b])) or abs(off) < 1e-300:
        return False
    theta = 0.5 * (A[b, b] - A[a, a]) / off
    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
    t = t if theta >= 0.0 else -t
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    for r in range(4):
        u, v = A[r, a], A[r, b]
        A[r, a], A[r, b] = c * u - s * v, s * u + c * v
    for r in range(4):
        u, v = A[a, r], A[b, r]
        A[a, r], A[b, r] = c * u - s * v, s * u + c * v
    A[a, b] = A[b, a] = 0.0
    for r in range(4):
        u, v = E[r, a], E[r, b]
        E[r, a], E[r, b] = c * u - s * v, s * u + c * v
    return True
