"""Move the vertices of a closed surface along their normals until it encloses a given volume.

The volume of a surface whose vertices move by ``s z_i`` is a cubic polynomial of s. One pass over the faces
finds its coefficients.
"""

from __future__ import annotations

import numpy as np

from sshade.kernels import kernel
from sshade.mesh.mesh import unit_rows
from sshade.solver.constraints import add_gradients
from sshade.threads import in_ranges

#: Number of Newton steps for the root of the polynomial.
NEWTON_STEPS = 8


def shifted(
    V: np.ndarray, F: np.ndarray, weight: np.ndarray, volume: float, *, most: float, error: float
) -> np.ndarray:
    """Move vertices along their normals, all by one distance times their weights.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) uint32
        Faces of a closed and consistently oriented surface.
    weight : (n,) float64
    volume : float
        Volume to reach, in length^3.
    most : float
        Largest distance.
    error : float
        Error of the volume that is allowed.

    Returns
    -------
    (n, 3) float64
        V itself where no move is needed.
    """
    n, origin = len(V), V[F[0, 0]]
    Z = np.zeros_like(V)
    add_gradients(F, V, 1.0, 0.0, Z, Z, 0, n)
    Z = weight[:, None] * unit_rows(Z)
    total = sum(in_ranges(lambda first, end: _volume(first, end, F, V, Z, origin), len(F)))
    now, a, b, c = total.tolist()
    deficit, shift = volume - now, 0.0
    for _ in range(NEWTON_STEPS):
        missing, slope = deficit - shift * (a + shift * (b + shift * c)), a + shift * (2 * b + shift * 3 * c)
        if abs(missing) <= error or slope <= 0.0:
            break
        shift = float(np.clip(shift + missing / slope, -most, most))
    if shift == 0.0:
        return V
    return V + shift * Z


@kernel
def _volume(first, end, F, V, Z, origin):
    """(4,) coefficients of 1, s, s^2 and s^3 of the volume of V + s Z, over a range of faces."""
    zero, one, two, three = 0.0, 0.0, 0.0, 0.0
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        px, py, pz = V[i, 0] - origin[0], V[i, 1] - origin[1], V[i, 2] - origin[2]
        ax, ay, az = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        bx, by, bz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        zx, zy, zz = Z[i, 0], Z[i, 1], Z[i, 2]
        cx, cy, cz = Z[j, 0] - zx, Z[j, 1] - zy, Z[j, 2] - zz
        dx, dy, dz = Z[k, 0] - zx, Z[k, 1] - zy, Z[k, 2] - zz
        # (a + s c) x (b + s d) = n + s m + s^2 l
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        mx, my = ay * dz - az * dy + cy * bz - cz * by, az * dx - ax * dz + cz * bx - cx * bz
        mz = ax * dy - ay * dx + cx * by - cy * bx
        lx, ly, lz = cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx
        zero += px * nx + py * ny + pz * nz
        one += zx * nx + zy * ny + zz * nz + px * mx + py * my + pz * mz
        two += zx * mx + zy * my + zz * mz + px * lx + py * ly + pz * lz
        three += zx * lx + zy * ly + zz * lz
    return np.array([zero, one, two, three]) / 6.0
