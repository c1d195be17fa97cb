"""The paper's frames: rigid frames on the triangles of the proxy.

The frame of a triangle is its local reference frame:

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

from sshade.core.kernels import kernel
from sshade.core.threads import ThreadTeam
from sshade.mesh.mesh import Mesh
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.frames import ZERO_AREA, Frames, Placer
from sshade.proxy.projection import Projection
from sshade.proxy.vertex_maps import adjacent_triangles, fill_from_neighbours

#: Length of the tangential gradient below which another function replaces f on a triangle. A coordinate has a
#: gradient of length up to 1.
FLAT = 0.1


def frame_values(proxy: Mesh, axis: int | None = None) -> np.ndarray:
    """Return the values of the frame function f at the corners of each triangle of N at rest.

    f is a coordinate. Where its tangential gradient is shorter than :data:`FLAT`, the coordinate of largest
    extent among the others replaces it.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    axis : int, optional
        Number of the coordinate; by default the coordinate of largest extent. The paper
        does not say which one.

    Returns
    -------
    (l, 3) float64
    """
    order = np.argsort(-np.ptp(proxy.V, axis=0), kind="stable")
    axis = order[0] if axis is None else axis
    second = order[1] if axis == order[0] else order[0]
    first, fallback = proxy.V[:, axis][proxy.F], proxy.V[:, second][proxy.F]
    flat = np.linalg.norm(_gradients(proxy.V, proxy.F, first)[0], axis=1) < FLAT
    return np.where(flat[:, None], fallback, first)


def _gradients(V: np.ndarray, F: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of f on triangles, and unit normals, both (l, 3); 0 on zero-area triangles."""
    e1, e2, normal, doubled = edges_and_normals(V, F)
    change = values[:, 1:] - values[:, :1]
    gradient = change[:, :1] * np.cross(e2, normal) + change[:, 1:] * np.cross(normal, e1)
    return np.divide(gradient, doubled[:, None], out=gradient, where=doubled[:, None] > 0), normal


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
    def at_rest(cls, proxy: Mesh) -> TriangleFrames:
        """Return the frames of N at rest for the default frame function; see :func:`frame_values`."""
        return cls.of_values(proxy, frame_values(proxy))

    @classmethod
    def of_values(cls, proxy: Mesh, values: np.ndarray) -> TriangleFrames:
        """Return the frames of N at rest for the corner values (l, 3) of f."""
        L, origin, degenerate = _frames(proxy.V, proxy.F, values)
        return cls(proxy.F, values, L, origin, degenerate)

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the coordinates v_t = L_t^-1 (v - b_t); see :class:`sshade.proxy.frames.Frames`."""
        local, arm = np.empty_like(V), V - self.origin[on.face]
        inverse = np.ascontiguousarray(self.L.transpose(0, 2, 1))
        place_on_triangles(0, len(V), arm, on.face, inverse, np.zeros_like(self.origin), local)
        return local

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at L_t' v_t + b_t'; see :class:`sshade.proxy.frames.Frames`."""
        L, origin, degenerate = _frames(NV, self.F, self.values)
        missing = degenerate | self.degenerate
        if missing.any():
            turns = fill_from_neighbours(
                L @ self.L.transpose(0, 2, 1),
                ~missing,
                pairs=adjacent_triangles(self.F),
                onto=nearest_rotations,
            )
            L[missing] = turns[missing] @ self.L[missing]
        return on_triangles(L, origin), int(missing.sum())


def _frames(V: np.ndarray, F: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return L (l, 3, 3), the identity without a gradient, origins (l, 3), and where (l,) there is none."""
    gradient, n = _gradients(V, F, values)
    length = np.linalg.norm(gradient, axis=1)
    known = length > 0
    g = gradient / np.where(known, length, 1.0)[:, None]
    L = np.stack([g, np.cross(g, n), n], axis=2)
    L[~known] = np.eye(3)
    return L, (V[F[:, 0]] + V[F[:, 1]] + V[F[:, 2]]) / 3.0, ~known


def edges_and_normals(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the edges from the first corner, the unit normals, and the doubled areas of triangles.

    Shapes are (l, 3) and (l,). Normal and area are 0 up to :data:`ZERO_AREA`.
    """
    a, b, c = (V[F[:, corner]] for corner in range(3))
    e1, e2 = b - a, c - a
    n, longest = np.cross(e1, e2), np.max([(e**2).sum(axis=1) for e in (e1, e2, e1 - e2)], axis=0)
    doubled = np.linalg.norm(n, axis=1)
    doubled[doubled <= ZERO_AREA * longest] = 0.0
    return e1, e2, np.divide(n, doubled[:, None], out=np.zeros_like(n), where=doubled[:, None] > 0), doubled


def on_triangles(A: np.ndarray, origin: np.ndarray) -> Placer:
    """Return a function that places points on triangles t at ``A_t local + origin_t``."""
    return lambda first, end, local, on, V: place_on_triangles(first, end, local, on.face, A, origin, V)


@kernel
def place_on_triangles(first, end, local, face, A, origin, V):
    """Write V_i = A_t local_i + origin_t for points i in triangles t, with A (l, 3, 3) and origin (l, 3)."""
    for i in range(first, end):
        t = face[i]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for a in range(3):
            V[i, a] = A[t, a, 0] * x + A[t, a, 1] * y + A[t, a, 2] * z + origin[t, a]
