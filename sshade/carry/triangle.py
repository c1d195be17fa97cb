"""The paper's local reference frames: a rigid frame on each triangle of the proxy.

    v_t = L_t^-1 (v - b_t)          coordinates on N at rest
    v'  = L_t' v_t + b_t'           position on N'

The origin b_t is the barycentre of triangle t. The columns of L_t = (g_t, w_t, n_t) are the direction g_t of
the gradient of a scalar function f on the triangle, the unit normal n_t, and w_t = g_t x n_t. The gradient is
normalised; with its length in L, a stretch of the triangle along g would be inverted. L_t is orthogonal
with determinant -1, which cancels between the frames at rest and deformed.

Source: SShaDe, after S. Melzi, R. Spezialetti, F. Tombari, M. Bronstein, L. Di Stefano, E. Rodola, "GFrames:
gradient-based local reference frame for 3D shape matching", 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from sshade.carry.blended import nearest_rotations
from sshade.carry.frames import ZERO_AREA, Frames, Placer, place_on_triangles
from sshade.carry.neighbours import adjacent_triangles, fill_from_neighbours
from sshade.carry.projection import Projection
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.threads import ThreadTeam

#: Length of the tangential gradient below which another function replaces f on a triangle. A coordinate has a
#: gradient of length up to 1.
FLAT = 0.1


def frame_values(proxy: Mesh, function: str | np.ndarray = "extent") -> np.ndarray:
    """Return the values of the frame function f at the corners of each triangle of N at rest.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    function : {"extent", "best", "x", "y", "z"} or (k,) float64
        ``extent`` is the coordinate of largest extent, as in the paper. ``best`` is, on each triangle, the
        coordinate with the largest tangential gradient, whose length is at least sqrt(2/3). An array holds
        one value for each vertex of N; it is scaled to a range of one bounding-box diagonal. If
        the gradient is shorter than :data:`FLAT`, another function replaces f: the coordinate of next largest
        extent in place of a coordinate, ``best`` in place of an array.

    Returns
    -------
    (l, 3) float64

    Raises
    ------
    InputError
        On an unknown name, a wrong number of values, values that are not finite, or constant values.
    """
    # Along axis c the tangential gradient has length sqrt(1 - n_c^2).
    steepest = np.argmin(np.abs(proxy.face_normals), axis=1)
    best = np.take_along_axis(proxy.V[proxy.F], steepest[:, None, None], axis=2)[:, :, 0]
    order = np.argsort(-np.ptp(proxy.V, axis=0), kind="stable")
    if isinstance(function, str):
        if function == "best":
            return best
        named = {"extent": order[0], "x": 0, "y": 1, "z": 2}
        if function not in named:
            raise InputError(f"unknown frame function {function!r}; use extent, best, x, y or z")
        axis = named[function]
        second = order[1] if axis == order[0] else order[0]
        first, fallback = proxy.V[:, axis][proxy.F], proxy.V[:, second][proxy.F]
    else:
        values = np.asarray(function, dtype=np.float64)
        if values.shape != (proxy.n,) or not np.isfinite(values).all():
            raise InputError(
                f"a frame function needs {proxy.n} finite values, one a proxy vertex, not {values.shape}"
            )
        if np.ptp(values) == 0:
            raise InputError("the frame function is constant; it needs a gradient")
        first, fallback = values[proxy.F] * (proxy.diagonal / np.ptp(values)), best
    flat = _gradient_length(proxy, first) < FLAT
    return np.where(flat[:, None], fallback, first)


def _gradient_length(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """Return the lengths (l,) of the tangential gradient; 0 on zero-area triangles."""
    a, b, c = (mesh.V[mesh.F[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    gradient = (values[:, 1] - values[:, 0])[:, None] * np.cross(c - a, normal)
    gradient += (values[:, 2] - values[:, 0])[:, None] * np.cross(normal, b - a)
    squared = (normal**2).sum(axis=1)
    length = np.linalg.norm(gradient, axis=1)
    return np.divide(length, squared, out=np.zeros(len(squared)), where=squared > 0)


@dataclass(frozen=True, eq=False)
class TriangleFrames(Frames):
    """The rigid frames of a proxy's triangles at rest.

    A zero-area triangle of N' has no frame L'. R L replaces it, with R the rotation nearest to the mean of
    L' L^T over the edge neighbours.

    Parameters
    ----------
    F : (l, 3) int64
        Triangles of N.
    values : (l, 3) float64
        f at their corners; see :func:`frame_values`.
    L : (l, 3, 3) float64
        Frames at rest, with g, w and n as columns; the identity on zero-area triangles.
    origin : (l, 3) float64
        Barycentres at rest.
    degenerate : (l,) bool
        Zero-area triangles at rest.
    """

    name: ClassVar[str] = "triangle"  # type: ignore[misc]

    F: np.ndarray
    values: np.ndarray
    L: np.ndarray
    origin: np.ndarray
    degenerate: np.ndarray

    @classmethod
    def at_rest(cls, proxy: Mesh, function: str | np.ndarray = "extent") -> TriangleFrames:
        """Return the frames of N at rest for a frame function; see :func:`frame_values`."""
        return cls.of_values(proxy, frame_values(proxy, function))

    @classmethod
    def of_values(cls, proxy: Mesh, values: np.ndarray) -> TriangleFrames:
        """Return the frames of N at rest for the corner values (l, 3) of f."""
        L, origin, degenerate = _frames(proxy.V, proxy.F, values, ZERO_AREA)
        return cls(proxy.F, values, L, origin, degenerate)

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the coordinates v_t = L_t^-1 (v - b_t); see :class:`sshade.carry.frames.Frames`."""
        local, arm = np.empty_like(V), V - self.origin[on.face]
        inverse = np.ascontiguousarray(self.L.transpose(0, 2, 1))
        place_on_triangles(0, len(V), arm, on.face, inverse, np.zeros_like(self.origin), local)
        return local

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at L_t' v_t + b_t'; see :class:`sshade.carry.frames.Frames`."""
        L, origin, degenerate = _frames(NV, self.F, self.values, ZERO_AREA)
        missing = degenerate | self.degenerate
        if missing.any():
            turns = fill_from_neighbours(
                L @ self.L.transpose(0, 2, 1),
                ~missing,
                pairs=adjacent_triangles(self.F),
                onto=nearest_rotations,
            )
            L[missing] = turns[missing] @ self.L[missing]

        def place(first: int, end: int, local: np.ndarray, on: Projection, V: np.ndarray) -> None:
            place_on_triangles(first, end, local, on.face, L, origin, V)

        return place, int(missing.sum())


@njit(cache=True, nogil=True)
def _frames(V, F, values, zero_area):
    m = F.shape[0]
    L = np.empty((m, 3, 3), dtype=np.float64)
    origin = np.empty((m, 3), dtype=np.float64)
    degenerate = np.zeros(m, dtype=np.bool_)
    e1, e2, normal, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for t in range(m):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        for x in range(3):
            origin[t, x] = (V[a, x] + V[b, x] + V[c, x]) / 3.0
            e1[x], e2[x] = V[b, x] - V[a, x], V[c, x] - V[a, x]
        for x in range(3):
            normal[x] = e1[(x + 1) % 3] * e2[(x + 2) % 3] - e1[(x + 2) % 3] * e2[(x + 1) % 3]
        l1, l2, l3 = 0.0, 0.0, 0.0
        for x in range(3):
            l1 += e1[x] * e1[x]
            l2 += e2[x] * e2[x]
            l3 += (e1[x] - e2[x]) ** 2
        longest = max(l1, l2, l3)
        doubled = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        df1, df2 = values[t, 1] - values[t, 0], values[t, 2] - values[t, 0]
        # The gradient times the squared doubled area; only the direction matters.
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            g[x] = df1 * (e2[y] * normal[z] - e2[z] * normal[y])
            g[x] += df2 * (normal[y] * e1[z] - normal[z] * e1[y])
        length = np.sqrt(g[0] ** 2 + g[1] ** 2 + g[2] ** 2)
        if doubled <= zero_area * longest or length == 0.0:
            degenerate[t] = True
            L[t] = np.eye(3)
            continue
        for x in range(3):
            L[t, x, 0] = g[x] / length
            L[t, x, 2] = normal[x] / doubled
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            L[t, x, 1] = L[t, y, 0] * L[t, z, 2] - L[t, z, 0] * L[t, y, 2]
    return L, origin, degenerate
