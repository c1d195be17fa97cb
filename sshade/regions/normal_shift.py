"""Move the vertices of a closed surface along their normals until it encloses a given volume.

The volume of a closed surface whose vertices v_i move by ``s z_i`` is a cubic polynomial of s. With g_i the
gradient of the volume at positions v, and h_i the gradient at positions z, it is

    1/3 sum g_i . v_i + s sum g_i . z_i + s^2 sum h_i . v_i + s^3 1/3 sum h_i . z_i .
"""

from __future__ import annotations

import numpy as np

from sshade.core.kernels import kernel
from sshade.core.threads import CHUNK, ThreadTeam, available_cpus
from sshade.solver.constraints import VOLUME_ALONE, add_gradients

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
        low = sum(team.ranges(_directions, n, *G, weight, V, origin, Z, rows=CHUNK))
        high = sum(team.ranges(_higher, len(F), F, V, Z, origin, rows=CHUNK))
    now, a, b, c = np.concatenate([low, high]).tolist()
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
def _directions(first, end, G, H, weight, V, origin, Z):
    """Write the unit vectors along G + H, times weights (n,), to Z (n, 3); 0 where the sum is 0.

    Returns (2,) the coefficients of 1 and s, for the gradient G + H and a range of vertices.
    """
    zero, one = 0.0, 0.0
    for i in range(first, end):
        x, y, z = G[i, 0] + H[i, 0], G[i, 1] + H[i, 1], G[i, 2] + H[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        factor = weight[i] / length if length > 0.0 else 0.0
        Z[i, 0], Z[i, 1], Z[i, 2] = factor * x, factor * y, factor * z
        zero += x * (V[i, 0] - origin[0]) + y * (V[i, 1] - origin[1]) + z * (V[i, 2] - origin[2])
        one += factor * length * length
    return np.array([zero / 3.0, one])


@kernel(fastmath={"contract"})
def _higher(first, end, F, V, Z, origin):
    """(2,) coefficients of s^2 and s^3, for a range of faces."""
    two, three = 0.0, 0.0
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = Z[j, 0] - Z[i, 0], Z[j, 1] - Z[i, 1], Z[j, 2] - Z[i, 2]
        bx, by, bz = Z[k, 0] - Z[i, 0], Z[k, 1] - Z[i, 1], Z[k, 2] - Z[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        two += x * (V[i, 0] + V[j, 0] + V[k, 0] - 3.0 * origin[0])
        two += y * (V[i, 1] + V[j, 1] + V[k, 1] - 3.0 * origin[1])
        two += z * (V[i, 2] + V[j, 2] + V[k, 2] - 3.0 * origin[2])
        three += x * (Z[i, 0] + Z[j, 0] + Z[k, 0])
        three += y * (Z[i, 1] + Z[j, 1] + Z[k, 1])
        three += z * (Z[i, 2] + Z[j, 2] + Z[k, 2])
    return np.array([two / 6.0, three / 18.0])
