"""Areas of triangles and of vertices, and triangles without any: in threads, in the memory of the result."""

from __future__ import annotations

import numpy as np
from numba import njit

from sshade.threads import in_ranges

#: A face whose doubled area is at most this, times its longest edge squared, has none: its cotangents
#: would be 10^8 and more, and rounding, not the shape, would decide on them.
NO_AREA = 1e-8


def face_areas(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(m,) areas of the triangles F (m, 3) of positions V (n, 3)."""
    areas = np.empty(len(F))
    in_ranges(lambda first, end: _areas(first, end, V, F, areas), len(F))
    return areas


def vertex_areas(F: np.ndarray, areas: np.ndarray, n: int) -> np.ndarray:
    """(n,) a third of the areas (m,) of the triangles around each vertex."""
    total = np.zeros(n)
    _share_out(F, areas, total)
    return total


def without_area(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(m,) bool: triangles with no area to speak of, needles and those collapsed; see :data:`NO_AREA`."""
    found = np.empty(len(F), dtype=np.bool_)
    in_ranges(lambda first, end: _without_area(first, end, V, F, found), len(F))
    return found


@njit(cache=True, nogil=True)
def _areas(first, end, V, F, areas):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        bx, by, bz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        areas[t] = 0.5 * np.sqrt(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _share_out(F, areas, total):
    for t in range(len(F)):
        third = areas[t] / 3.0
        for c in range(3):
            total[F[t, c]] += third


@njit(cache=True, nogil=True)
def _without_area(first, end, V, F, found):
    for t in range(first, end):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
        bx, by, bz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        cx, cy, cz = bx - ax, by - ay, bz - az
        longest = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz)
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        found[t] = not np.sqrt(x * x + y * y + z * z) > NO_AREA * longest
