"""Affine frames, which stretch with the proxy, where the frames of `sshade` only turn.

A triangle with first corner a, edges e1, e2 and unit normal n, deformed to a', e1', e2', n', defines an
affine map with the linear part A:

    A = [e1' e2' n'] [e1 e2 n]^-1
    x' = a' + A (x - a) .

In the plane of the triangle the map interpolates the corners linearly, so that neighbouring triangles agree
along their edge. Off the plane their normals differ, and x' jumps.

Frames at vertices do not jump. Vertex i has a symmetric matrix S_i in addition to the pose of a blended frame
(:mod:`sshade.proxy.blended`): R_i S_i is the affine map of the edges around the vertex
(:mod:`sshade.proxy.vertex_maps`). The offset becomes R(w) S(w) (x - p) with S(w) = sum_i w_i S_i, and b_ij
gets the second-order term of the stretch, R (S_i - S_j) (v_j - v_i) / 2 with R at the edge's middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import ThreadTeam
from sshade.mesh.mesh import Mesh
from sshade.proxy import blended
from sshade.proxy.frames import Frames, Placer
from sshade.proxy.projection import Projection
from sshade.proxy.triangle import edges_and_normals, on_triangles
from sshade.proxy.vertex_maps import adjacent_triangles, fill_from_neighbours


@dataclass(frozen=True, eq=False)
class AffineFrames(Frames):
    """Frames that follow the affine maps of a proxy's triangles.

    A triangle without area gets the mean A of its edge neighbours.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    name: ClassVar[str] = "affine"

    proxy: Mesh

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the offsets x - a from the first corners; see :class:`sshade.proxy.frames.Frames`."""
        return V - self.proxy.V[self.proxy.F[on.face, 0]]

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at a' + A (x - a); see :class:`sshade.proxy.frames.Frames`."""
        F = self.proxy.F
        A, known = affine_maps(self.proxy.V, NV, F=F)
        if not known.all():
            A = fill_from_neighbours(A, known, pairs=adjacent_triangles(F))
        return on_triangles(A, NV[F[:, 0]]), int((~known).sum())


def affine_maps(rest: np.ndarray, deformed: np.ndarray, *, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear part A of the affine map of each triangle.

    Parameters
    ----------
    rest, deformed : (k, 3) float64
        Vertices of N and N'.
    F : (l, 3) int
        Triangles.

    Returns
    -------
    A : (l, 3, 3) float64
        Zero where undefined.
    known : (l,) bool
        False for triangles without area in N or N'.
    """
    e1, e2, n, doubled = edges_and_normals(rest, F)
    d1, d2, m, deformed_doubled = edges_and_normals(deformed, F)
    known = (doubled > 0) & (deformed_doubled > 0)
    doubled = np.where(known, doubled, 1.0)
    # Rows of the inverse of [e1 e2 n]: e2 x n and n x e1 over the doubled area, and n.
    rows = (np.cross(e2, n) / doubled[:, None], np.cross(n, e1) / doubled[:, None], n)
    A = sum(d[:, :, None] * row[:, None] for d, row in zip((d1, d2, m), rows, strict=True))
    A[~known] = 0.0
    return A, known


@dataclass(frozen=True, eq=False)
class StretchingFrames(blended.BlendedFrames):
    """Frames at a proxy's vertices that turn and stretch like the edges around the vertex.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    name: ClassVar[str] = "blended_affine"

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at o(w) + R(w) S(w) (x - p); see :class:`sshade.proxy.frames.Frames`.

        The frames are fitted to N' alone. `rotations` are unused.
        """
        F = self.proxy.F
        A, known = self.maps(NV)
        R = blended.nearest_rotations(A)
        S = np.ascontiguousarray(R.transpose(0, 2, 1) @ A)
        triangles, Q = blended.posed_triangles(F, NV, R, team)
        triangles[:, blended.BULGE : blended.QUATERNION] += _bulges(F, self.proxy.V, Q, S)

        def place(first: int, end: int, local: np.ndarray, on: Projection, V: np.ndarray) -> None:
            _stretch(first, end, local, on.face, on.barycentric, F, S, V)
            blended.place_blended(first, end, V, on.face, on.barycentric, triangles, V)

        return place, int((~known).sum())


@kernel(fastmath={"contract"})
def _bulges(F, rest, Q, S):
    """Return the parts R (S_i - S_j) (v_j - v_i) / 2 of the bulges bc, ca and ab (l, 9).

    R is the blend of R_i and R_j in equal parts.
    """
    b, q, g = np.empty((len(F), 9)), np.empty(4), np.empty(3)
    for t in range(len(F)):
        for k in range(3):
            i, j = F[t, (k + 1) % 3], F[t, (k + 2) % 3]
            cosine = Q[i, 0] * Q[j, 0] + Q[i, 1] * Q[j, 1] + Q[i, 2] * Q[j, 2] + Q[i, 3] * Q[j, 3]
            sign = 1.0 if cosine >= 0.0 else -1.0
            for r in range(4):
                q[r] = Q[i, r] + sign * Q[j, r]
            for r in range(3):
                g[r] = 0.0
                for s in range(3):
                    g[r] += 0.5 * (S[i, r, s] - S[j, r, s]) * (rest[j, s] - rest[i, s])
            x, y, z = _turned(q[0], q[1], q[2], q[3], g[0], g[1], g[2])
            b[t, 3 * k], b[t, 3 * k + 1], b[t, 3 * k + 2] = x, y, z
    return b


@subroutine
def _turned(w, x, y, z, u, v, s):
    """Rotate the vector (u, v, s) by the quaternion (w, x, y, z) of any length."""
    n = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = n * (y * s - z * v), n * (z * u - x * s), n * (x * v - y * u)
    return u + w * tx + y * tz - z * ty, v + w * ty + z * tx - x * tz, s + w * tz + x * ty - y * tx


@kernel(fastmath={"contract"})
def _stretch(first, end, local, face, barycentric, F, S, V):
    """Write the stretched offsets S(w) (x - p) to V."""
    for i in range(first, end):
        a, b, c = F[face[i], 0], F[face[i], 1], F[face[i], 2]
        wa, wb, wc = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for r in range(3):
            u = wa * S[a, r, 0] + wb * S[b, r, 0] + wc * S[c, r, 0]
            v = wa * S[a, r, 1] + wb * S[b, r, 1] + wc * S[c, r, 1]
            w = wa * S[a, r, 2] + wb * S[b, r, 2] + wc * S[c, r, 2]
            V[i, r] = u * x + v * y + w * z
