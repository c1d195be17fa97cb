"""Rotation fits: the rotation nearest to each of many matrices, warm-started from the last rotations.

Rotations are stored as unit quaternions (w, x, y, z), which stay orthogonal over any number of warm-started
updates. Newton's method works on :data:`LANES` rotations together, in loops without branches over one number
of each rotation, which the compiler vectorises.
"""

from __future__ import annotations

import numpy as np

from sshade.core.kernels import kernel, subroutine

#: Number of rotations that are fitted together; their work array fits into the first-level cache.
LANES = 128
#: Length of a Newton step (radians) whose error, its cube, is below rounding.
LAST_STEP = 1e-6
#: Longest Newton step (radians), and largest number of steps. Beyond them the eigenvector decides.
LONGEST_STEP = 0.5
MOST_STEPS = 6
#: Smallest accepted det H / (tr H)^3 of H = tr T - sym T, the matrix of a Newton step. Below it the rotation
#: is nearly undetermined.
SMALLEST_DETERMINANT = 1e-10
#: Relative distance from the largest eigenvalue up to which an eigenvalue counts as equal.
SAME_EIGENVALUE = 1e-13
JACOBI_SWEEPS = 30
#: How far the fit of a lane is.
_PENDING, _FITTED, _UNCERTAIN = 0, 1, 2


@kernel(fastmath={"contract"})
def fit_rotations(S, Q):
    """Compute for each matrix S_i the rotation R_i that maximises tr(R_i S_i).

    R_i equals ``V diag(1, 1, det(V U^T)) U^T`` of the singular value decomposition ``S = U diag(s) V^T``.
    Newton's method on the rotation group finds it, started from the previous rotation. The step is
    (tr T - sym T)^-1 times the axial vector of T = R S, and its error is the cube of its length. A stationary
    point with a positive definite matrix is the global maximum, so that Newton's result is certain. If the
    matrix is not positive definite, or a step is long, the largest eigenvector of Horn's 4 x 4 matrix
    decides. If S leaves the rotation undetermined (rank one or zero), the previous rotation makes the
    smallest turn to a maximiser.

    Parameters
    ----------
    S : (n, 9) float64
        Covariances ``sum w e e'^T`` (rest times deformed), row by row, of any scale; replaced by the
        rotation matrices.
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
    C, q, R = np.empty((9, LANES)), np.empty((4, LANES)), np.empty((9, LANES))
    step, trace, size, state = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES, np.int64)
    A, E = np.empty((4, 4)), np.empty((4, 4))
    total = 0.0
    for first in range(0, len(S), LANES):
        own, near = S[first : first + LANES], Q[first : first + LANES]
        pending = _load(own, near, C, q, size, state)
        for _ in range(MOST_STEPS):
            if pending == 0:
                break
            _newton_steps(C, q, step, len(own))
            pending = _decide(q, step, near, state)
        for i in range(len(own)):
            if state[i] != _FITTED:
                _largest_eigenvector(C[:, i], near[i], A, E)
            for c in range(4):
                q[c, i] = near[i, c]
        _matrices(C, q, R, trace, len(own))
        for i in range(len(own)):
            for c in range(9):
                own[i, c] = R[c, i]
            total += size[i] * trace[i]
    return total


@kernel
def quaternions(R):
    """Convert rotation matrices to unit quaternions.

    Parameters
    ----------
    R : (n, 3, 3) float64

    Returns
    -------
    Q : (n, 4) float64
        (w, x, y, z).
    error : float
        Largest sum of absolute differences between a matrix and its quaternion's rotation. It is far from 0
        if a matrix is no rotation, and NaN if a matrix has NaN.
    """
    Q = np.empty((len(R), 4))
    error = 0.0
    for i in range(len(R)):
        a, b, c = R[i, 0, 0], R[i, 1, 1], R[i, 2, 2]
        x, y, z = R[i, 2, 1] - R[i, 1, 2], R[i, 0, 2] - R[i, 2, 0], R[i, 1, 0] - R[i, 0, 1]
        xy, xz, yz = R[i, 0, 1] + R[i, 1, 0], R[i, 0, 2] + R[i, 2, 0], R[i, 1, 2] + R[i, 2, 1]
        # The components, times four times the largest one.
        if a + b + c > 0.0:
            q = (1.0 + a + b + c, x, y, z)
        elif a >= b and a >= c:
            q = (x, 1.0 + a - b - c, xy, xz)
        elif b >= c:
            q = (y, xy, 1.0 - a + b - c, yz)
        else:
            q = (z, xz, yz, 1.0 - a - b + c)
        scale = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        w, x, y, z = scale * q[0], scale * q[1], scale * q[2], scale * q[3]
        Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3] = w, x, y, z
        off, matrix = 0.0, _matrix(w, x, y, z)
        for k in range(9):
            off += abs(R[i, k // 3, k % 3] - matrix[k])
        if off > error or off != off:  # NaN stays
            error = off
    return Q, error


# Without numpy's error model, the test for a division by zero is a branch in the loop.
@subroutine(error_model="numpy", fastmath={"contract"})
def _load(S, Q, C, q, size, state):
    """Write S, scaled to a largest entry of 1, to C, and Q to q; return the number of nonzero lanes."""
    pending, lanes = 0, len(S)
    for i in range(lanes):
        largest = 0.0
        for c in range(9):
            largest = max(largest, abs(S[i, c]))
            C[c, i] = S[i, c]
        size[i], state[i] = largest, _PENDING if largest > 0.0 else _FITTED
        pending += largest > 0.0
        for c in range(4):
            q[c, i] = Q[i, c]
    for c in range(9):
        for i in range(lanes):
            C[c, i] /= size[i] if size[i] > 0.0 else 1.0
    return pending


@subroutine
def _decide(q, step, Q, state):
    """Accept quaternions whose last step was short; return the number of lanes still pending."""
    pending = 0
    for i in range(len(Q)):
        if state[i] == _PENDING:
            if step[i] < LAST_STEP * LAST_STEP:
                state[i] = _FITTED
                for c in range(4):
                    Q[i, c] = q[c, i]
            elif step[i] == np.inf:
                state[i] = _UNCERTAIN
            else:
                pending += 1
    return pending


@subroutine(error_model="numpy", fastmath={"contract"})
def _newton_steps(C, q, squared_step, lanes):
    """Improve the quaternions q, and write the squared steps: infinity for uncertain ones."""
    for i in range(lanes):
        w, x, y, z = q[0, i], q[1, i], q[2, i], q[3, i]
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = _matrix(w, x, y, z)
        c00, c01, c02 = C[0, i], C[1, i], C[2, i]
        c10, c11, c12 = C[3, i], C[4, i], C[5, i]
        c20, c21, c22 = C[6, i], C[7, i], C[8, i]
        t00 = r00 * c00 + r01 * c10 + r02 * c20
        t01 = r00 * c01 + r01 * c11 + r02 * c21
        t02 = r00 * c02 + r01 * c12 + r02 * c22
        t10 = r10 * c00 + r11 * c10 + r12 * c20
        t11 = r10 * c01 + r11 * c11 + r12 * c21
        t12 = r10 * c02 + r11 * c12 + r12 * c22
        t20 = r20 * c00 + r21 * c10 + r22 * c20
        t21 = r20 * c01 + r21 * c11 + r22 * c21
        t22 = r20 * c02 + r21 * c12 + r22 * c22
        gx, gy, gz = t12 - t21, t20 - t02, t01 - t10
        h00, h11, h22 = t11 + t22, t00 + t22, t00 + t11
        h01, h02, h12 = -0.5 * (t01 + t10), -0.5 * (t02 + t20), -0.5 * (t12 + t21)
        # The inverse by cofactors: Sylvester's three minors come with it.
        k00, k01, k02 = h11 * h22 - h12 * h12, h02 * h12 - h01 * h22, h01 * h12 - h02 * h11
        k11, k12, k22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
        determinant = h00 * k00 + h01 * k01 + h02 * k02
        trace = h00 + h11 + h22
        half = 0.5 / determinant
        ax = half * (k00 * gx + k01 * gy + k02 * gz)
        ay = half * (k01 * gx + k11 * gy + k12 * gz)
        az = half * (k02 * gx + k12 * gy + k22 * gz)
        step = 4.0 * (ax * ax + ay * ay + az * az)
        certain = (
            (h00 > 0.0)
            & (k22 > 0.0)
            & (determinant > SMALLEST_DETERMINANT * trace * trace * trace)
            & (step <= LONGEST_STEP * LONGEST_STEP)
        )
        w, x, y, z = (
            w - ax * x - ay * y - az * z,
            x + ax * w + ay * z - az * y,
            y + ay * w + az * x - ax * z,
            z + az * w + ax * y - ay * x,
        )
        norm = np.sqrt(w * w + x * x + y * y + z * z)
        q[0, i], q[1, i], q[2, i], q[3, i] = w / norm, x / norm, y / norm, z / norm
        squared_step[i] = step if certain else np.inf


@subroutine(fastmath={"contract"})
def _matrices(C, q, R, trace, lanes):
    """Write the matrices R of the quaternions q, and tr(R C)."""
    for i in range(lanes):
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = _matrix(q[0, i], q[1, i], q[2, i], q[3, i])
        R[0, i], R[1, i], R[2, i] = r00, r01, r02
        R[3, i], R[4, i], R[5, i] = r10, r11, r12
        R[6, i], R[7, i], R[8, i] = r20, r21, r22
        total = r00 * C[0, i] + r01 * C[3, i] + r02 * C[6, i]
        total += r10 * C[1, i] + r11 * C[4, i] + r12 * C[7, i]
        total += r20 * C[2, i] + r21 * C[5, i] + r22 * C[8, i]
        trace[i] = total


@subroutine
def _matrix(w, x, y, z):
    """The rotation matrix of a unit quaternion, row by row."""
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@subroutine
def _largest_eigenvector(C, q, A, E):
    """Replace q by the nearest maximiser of tr(R C), by cyclic Jacobi rotations of Horn's matrix."""
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
    E[:] = np.eye(4)
    for _ in range(JACOBI_SWEEPS):
        rotated = False
        for a in range(3):
            for b in range(a + 1, 4):
                rotated |= _jacobi(A, E, a, b)
        if not rotated:
            break
    top, size = np.diag(A).max(), np.abs(np.diag(A)).max()
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


@subroutine
def _jacobi(A, E, a, b):
    """Annihilate A[a, b] by one rotation; False if it is already negligible."""
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
