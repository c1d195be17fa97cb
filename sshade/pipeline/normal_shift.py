"""Move the vertices of a closed surface along their normals until it encloses a given volume.

The volume of a surface whose vertices move by ``s z_i`` is a cubic polynomial of s. One pass over the faces
finds its coefficients.
"""

from __future__ import annotations

import numpy as np

from sshade.kernels import kernel
from sshade.solver.constraints import VOLUME_ALONE, add_gradients
from sshade.threads import CHUNK, ThreadTeam, available_cpus

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
    n, origin, half = len(V), V[F[0, 0]], -(-len(F) // 2)
    with ThreadTeam(available_cpus() if len(F) > CHUNK else 1) as team:
        # Each half of the faces has its own sums, so that results do not depend on the number of threads.
        G, Z = np.zeros((2, n, 3)), np.empty_like(V)
        team(lambda i: add_gradients(F[i * half :][:half], VOLUME_ALONE, V, 1.0, 0.0, G[i], G[i], 0, n), 2)
        team.ranges(lambda *own: _directions(*own, *G, weight, Z), n, rows=CHUNK)
        total = sum(team.ranges(lambda *own: _volume(*own, F, V, Z, origin), len(F), rows=CHUNK))
    now, a, b, c = total.tolist()
    deficit, shift = volume - now, 0.0
    for _ in range(NEWTON_STEPS):
        missing, slope = deficit - shift * (a + shift * (b + shift * c)), a + shift * (2 * b + shift * 3 * c)
        if abs(missing) <= error or slope <= 0.0:
            break
        shift = float(np.clip(shift + missing / slope, -most, most))
    if shift == 0.0:
        return V
    Z *= shift
    Z += V
    return Z


@kernel(fastmath={"contract"})
def _directions(first, end, G, H, weight, Z):
    """Write the unit vectors along G + H, times weights (n,), to Z (n, 3); 0 where the sum is 0."""
    for i in range(first, end):
        x, y, z = G[i, 0] + H[i, 0], G[i, 1] + H[i, 1], G[i, 2] + H[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        factor = weight[i] / length if length > 0.0 else 0.0
        Z[i, 0], Z[i, 1], Z[i, 2] = factor * x, factor * y, factor * z


@kernel(fastmath={"contract"})
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
