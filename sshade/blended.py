"""Frames at the vertices of the proxy, blended over its triangles.

Vertex i of N carries a pose (R_i, v_i'): how it is turned and where it is. A
point x of M that lies at p = w_a v_a + w_b v_b + w_c v_c on triangle (a, b, c)
keeps its offset d = x - p, and goes to

    x' = o + R d,    (R, o) = the blend of the poses with weights w,

a normalised dual-quaternion blend. The result is continuous across the
triangles' edges, where only the two poses of the edge count, and exact at
samples. Equal rotations blend to o = w_a v_a' + w_b v_b' + w_c v_c', so that
rigid motions come out as such.

Between two vertices the blend is a screw motion. To the second order

    o = sum_i w_i v_i' + 1/2 sum_i w_i R_i (p - v_i),

which is exact for quadratic maps whose rotations are R_i: a bent edge becomes
an arc. The weighted sum of the motions x -> v_i' + R_i (x - v_i) has the factor
1 in the place of 1/2, and bulges twice as far as the arc; and where the proxy
is twisted by half a turn between two vertices, it falls onto the axis
("candy wrapper"), while the screw turns around it.

L. Kavan, S. Collins, J. Zara, C. O'Sullivan, "Geometric skinning with
approximate dual quaternion blending", 2008.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.affine import affine_maps, spread_means
from sshade.mesh import Mesh
from sshade.projection import Projection
from sshade.rotations import fit_rotations


@dataclass(frozen=True, eq=False)
class BlendedFrames:
    """Points carried by the blended frames of a proxy's vertices.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    stretch : bool
        Frames stretch as the triangles around a vertex do in the mean, by area;
        otherwise they only turn.
    """

    proxy: Mesh
    stretch: bool = False

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Offsets d of points from where they lie on the proxy; see :class:`sshade.frames.Frames`."""
        return _offsets(V, on.face, on.barycentric, self.proxy.V, self.proxy.F)

    def decode(
        self, local: np.ndarray, NV: np.ndarray, *, on: Projection, rotations: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Points on a deformed proxy; see :class:`sshade.frames.Frames`.

        Rotations that are not given are fitted to the triangles around each
        vertex. Vertices whose triangles have no area turn as their neighbours
        do in the mean.
        """
        rest, F = self.proxy.V, self.proxy.F
        A, missing = affine_maps(rest, NV, F=F)
        where = (on.face, on.barycentric, F)
        if self.stretch:
            A = self._vertex_maps(A, missing)
            R, Q = nearest_rotations(A)
            T = np.ascontiguousarray(R.transpose(0, 2, 1) @ A)
            return _decode_stretched(local, *where, rest, NV, Q, R, T), int(missing.sum())
        if rotations is None:
            rotations = self._vertex_maps(A, missing)
        _, Q = nearest_rotations(rotations)
        return _decode(local, *where, NV, Q), int(missing.sum())

    def _vertex_maps(self, A: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """(k, 3, 3) means of the affine maps of the triangles at each vertex, weighted by rest area."""
        F, n = self.proxy.F, self.proxy.n
        weight = np.where(missing, 0.0, self.proxy.face_areas)
        corners, each = F.ravel(), np.repeat(weight, 3)
        total = np.bincount(corners, each, n)
        A = A.reshape(-1, 9) * weight[:, None]
        mean = np.stack([np.bincount(corners, np.repeat(A[:, c], 3), n) for c in range(9)], axis=1)
        known = total > 0
        mean = np.divide(mean, total[:, None], out=np.zeros_like(mean), where=known[:, None])
        return spread_means(mean.reshape(-1, 3, 3), known, pairs=self.proxy.edges)


def nearest_rotations(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotations nearest to some 3 x 3 matrices.

    Parameters
    ----------
    A : (k, 3, 3) float64

    Returns
    -------
    R : (k, 3, 3) float64
    Q : (k, 4) float64
        The same as unit quaternions (w, x, y, z).
    """
    R = np.array(A.transpose(0, 2, 1), dtype=np.float64, order="C").reshape(-1, 9)
    Q = np.tile([1.0, 0.0, 0.0, 0.0], (len(A), 1))
    fit_rotations(R, Q)
    return R.reshape(-1, 3, 3), Q


@njit(cache=True, nogil=True)
def _offsets(V, face, barycentric, NV, F):
    local = np.empty_like(V)
    for i in range(len(V)):
        t = face[i]
        for r in range(3):
            p = barycentric[i, 0] * NV[F[t, 0], r]
            p += barycentric[i, 1] * NV[F[t, 1], r]
            p += barycentric[i, 2] * NV[F[t, 2], r]
            local[i, r] = V[i, r] - p
    return local


@njit(cache=True, nogil=True)
def _by_weight(t, w, F):
    """Corners of triangle t and their weights, the largest weight first, the others in cyclic order."""
    s = 0
    if w[1] > w[s]:
        s = 1
    if w[2] > w[s]:
        s = 2
    b, c = (s + 1) % 3, (s + 2) % 3
    return F[t, s], F[t, b], F[t, c], w[s], w[b], w[c]


@njit(cache=True, nogil=True)
def _blend(a, b, c, wa, wb, wc, NV, Q):
    """Blended pose, relative to the position of a: a quaternion (not normalised), and the shift.

    Positions relative to one corner keep their digits far from the origin. With
    the heaviest corner as that one, the quaternion is never shorter than a third.
    """
    aw, ax, ay, az = Q[a, 0], Q[a, 1], Q[a, 2], Q[a, 3]
    if aw * Q[b, 0] + ax * Q[b, 1] + ay * Q[b, 2] + az * Q[b, 3] < 0.0:
        wb = -wb
    if aw * Q[c, 0] + ax * Q[c, 1] + ay * Q[c, 2] + az * Q[c, 3] < 0.0:
        wc = -wc
    bw, bx, by, bz = wb * Q[b, 0], wb * Q[b, 1], wb * Q[b, 2], wb * Q[b, 3]
    cw, cx, cy, cz = wc * Q[c, 0], wc * Q[c, 1], wc * Q[c, 2], wc * Q[c, 3]
    w, x, y, z = wa * aw + bw + cw, wa * ax + bx + cx, wa * ay + by + cy, wa * az + bz + cz
    ex, ey, ez = NV[b, 0] - NV[a, 0], NV[b, 1] - NV[a, 1], NV[b, 2] - NV[a, 2]
    fx, fy, fz = NV[c, 0] - NV[a, 0], NV[c, 1] - NV[a, 1], NV[c, 2] - NV[a, 2]
    # Twice the dual part: the sum of the products (0, e) q.
    dw = -(ex * bx + ey * by + ez * bz + fx * cx + fy * cy + fz * cz)
    dx = ex * bw + ey * bz - ez * by + fx * cw + fy * cz - fz * cy
    dy = ey * bw + ez * bx - ex * bz + fy * cw + fz * cx - fx * cz
    dz = ez * bw + ex * by - ey * bx + fz * cw + fx * cy - fy * cx
    norm = 1.0 / (w * w + x * x + y * y + z * z)
    sx = norm * (w * dx - dw * x - dy * z + dz * y)
    sy = norm * (w * dy - dw * y - dz * x + dx * z)
    sz = norm * (w * dz - dw * z - dx * y + dy * x)
    return w, x, y, z, norm, sx, sy, sz


@njit(cache=True, nogil=True)
def _turned(w, x, y, z, norm, u, v, s):
    """The vector (u, v, s) turned by the quaternion (w, x, y, z) of squared length 1 / norm."""
    tx, ty, tz = 2.0 * norm * (y * s - z * v), 2.0 * norm * (z * u - x * s), 2.0 * norm * (x * v - y * u)
    return u + w * tx + y * tz - z * ty, v + w * ty + z * tx - x * tz, s + w * tz + x * ty - y * tx


@njit(cache=True, nogil=True)
def _decode(local, face, barycentric, F, NV, Q):
    V = np.empty_like(local)
    for i in range(len(local)):
        a, b, c, wa, wb, wc = _by_weight(face[i], barycentric[i], F)
        w, x, y, z, norm, sx, sy, sz = _blend(a, b, c, wa, wb, wc, NV, Q)
        dx, dy, dz = _turned(w, x, y, z, norm, local[i, 0], local[i, 1], local[i, 2])
        V[i, 0], V[i, 1], V[i, 2] = NV[a, 0] + sx + dx, NV[a, 1] + sy + dy, NV[a, 2] + sz + dz
    return V


@njit(cache=True, nogil=True)
def _decode_stretched(local, face, barycentric, F, rest, NV, Q, R, T):
    V = np.empty_like(local)
    g, d = np.empty(3), np.empty(3)
    for i in range(len(local)):
        a, b, c, wa, wb, wc = _by_weight(face[i], barycentric[i], F)
        w, x, y, z, norm, sx, sy, sz = _blend(a, b, c, wa, wb, wc, NV, Q)
        V[i, 0], V[i, 1], V[i, 2] = NV[a, 0] + sx, NV[a, 1] + sy, NV[a, 2] + sz
        d[:] = 0.0
        for k, weight in ((a, wa), (b, wb), (c, wc)):
            for r in range(3):
                g[r] = wa * rest[a, r] + wb * rest[b, r] + wc * rest[c, r] - rest[k, r]
            gx = T[k, 0, 0] * g[0] + T[k, 0, 1] * g[1] + T[k, 0, 2] * g[2] - g[0]
            gy = T[k, 1, 0] * g[0] + T[k, 1, 1] * g[1] + T[k, 1, 2] * g[2] - g[1]
            gz = T[k, 2, 0] * g[0] + T[k, 2, 1] * g[1] + T[k, 2, 2] * g[2] - g[2]
            for r in range(3):
                V[i, r] += 0.5 * weight * (R[k, r, 0] * gx + R[k, r, 1] * gy + R[k, r, 2] * gz)
                d[r] += weight * (
                    T[k, r, 0] * local[i, 0] + T[k, r, 1] * local[i, 1] + T[k, r, 2] * local[i, 2]
                )
        dx, dy, dz = _turned(w, x, y, z, norm, d[0], d[1], d[2])
        V[i, 0] += dx
        V[i, 1] += dy
        V[i, 2] += dz
    return V
