"""Areas of triangles and of vertices, and the triangles that are too thin for cotangents."""

from __future__ import annotations

import numpy as np

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges

#: Largest doubled area, over the squared longest edge, of a face that counts as one without area. Its
#: cotangents would exceed 10^8, and rounding instead of the shape would determine them.
NO_AREA = 1e-8


def face_areas(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measure triangles F (m, 3) with corners at V (n, 3).

    Returns
    -------
    areas : (m,) float64
        In the squared unit of V.
    without_area : (m,) bool
        Triangles that are needles or collapsed; see :data:`NO_AREA`.
    """
    areas, without = np.empty(len(F)), np.empty(len(F), dtype=np.bool_)
    in_ranges(_areas, len(F), V, F, areas, without)
    return areas, without


@kernel
def vertex_areas(F, areas, n):
    """(n,) float64: a third of the areas (m,) of the triangles F (m, 3) around each of n vertices."""
    total = np.zeros(n)
    for t in range(len(F)):
        third = areas[t] / 3.0
        for c in range(3):
            total[F[t, c]] += third
    return total


@kernel
def _areas(first, end, V, F, areas, without):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        bx, by, bz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        cx, cy, cz = bx - ax, by - ay, bz - az
        longest = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz)
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        doubled = np.sqrt(x * x + y * y + z * z)
        areas[t], without[t] = 0.5 * doubled, not doubled > NO_AREA * longest
