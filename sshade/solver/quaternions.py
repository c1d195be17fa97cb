"""Unit quaternions of rotation matrices."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def quaternions(R):
    """Turn rotation matrices into unit quaternions.

    Parameters
    ----------
    R : (n, 3, 3) float64

    Returns
    -------
    Q : (n, 4) float64
        (w, x, y, z).
    error : float
        The largest sum of absolute differences between a matrix and its
        quaternion's rotation: far from 0 where R is none, NaN where it has NaN.
    """
    Q = np.empty((len(R), 4))
    error = 0.0
    for i in range(len(R)):
        a, b, c = R[i, 0, 0], R[i, 1, 1], R[i, 2, 2]
        x, y, z = R[i, 2, 1] - R[i, 1, 2], R[i, 0, 2] - R[i, 2, 0], R[i, 1, 0] - R[i, 0, 1]
        xy, xz, yz = R[i, 0, 1] + R[i, 1, 0], R[i, 0, 2] + R[i, 2, 0], R[i, 1, 2] + R[i, 2, 1]
        # Four times the largest of the components, times each.
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
        off = abs(a - 1.0 + 2.0 * (y * y + z * z)) + abs(b - 1.0 + 2.0 * (x * x + z * z))
        off += abs(c - 1.0 + 2.0 * (x * x + y * y))
        off += abs(R[i, 1, 0] - 2.0 * (x * y + w * z)) + abs(R[i, 0, 1] - 2.0 * (x * y - w * z))
        off += abs(R[i, 0, 2] - 2.0 * (x * z + w * y)) + abs(R[i, 2, 0] - 2.0 * (x * z - w * y))
        off += abs(R[i, 2, 1] - 2.0 * (y * z + w * x)) + abs(R[i, 1, 2] - 2.0 * (y * z - w * x))
        if off > error or off != off:  # NaN stays
            error = off
    return Q, error
