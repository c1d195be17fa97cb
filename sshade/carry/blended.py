"""Frames at the vertices of the proxy, blended over its triangles.

Vertex i of N has a pose: where it goes, v_i', and how it turns, R_i. A point x
of M that lies at p = w_a v_a + w_b v_b + w_c v_c on triangle (a, b, c) keeps
its offset x - p and goes to

    x' = o(w) + R(w) (x - p),
    o(w) = sum_i w_i v_i' + sum_{i<j} w_i w_j b_ij .

R(w) is the normalised blend of the corners' quaternions, and o(w) a quadratic
triangle. Half-way, its edges pass through the middle of the screw motion from
the pose of one end to that of the other: with (c, m) the scalar and the vector
part of the quaternion of R_j R_i^T,

    b_ij = 2 (v_j' - v_i') x m / (1 + c) .

That is continuous across the triangles' edges, where only the two poses of the
edge count, and exact at samples; equal rotations give b = 0, so that rigid
motions come out as such. To the second order b_ij = (R_i - R_j) (v_j - v_i) / 2,
which is what a quadratic map with these rotations does: a bent edge becomes an
arc. The plain weighted sum of the motions x -> v_i' + R_i (x - v_i) has twice
that b and bulges twice as far as the arc. Like every weighted sum of matrices
it also falls onto the axis where N is twisted by half a turn from one vertex to
the next (the candy wrapper); the screw goes around, the shorter way. Its limits:
at half a turn exactly both ways are as short, and rotations fitted to the edges
around a vertex see only a part of a twist that happens between two vertices.
Where the corners of one triangle are turned by more than a full turn in all,
R(w) has a jump at one of its edges, o(w) has none.

Frames that stretch have symmetric S_i beside R_i: R_i S_i is the affine map of
the edges around the vertex (:mod:`sshade.carry.vertex_maps`). The offset goes to
R(w) S(w) (x - p), S(w) = sum_i w_i S_i, and b_ij has the second-order part of
the stretch in addition, R (S_i - S_j) (v_j - v_i) / 2 with R of the edge's middle.

L. Kavan, S. Collins, J. Zara, C. O'Sullivan, "Geometric skinning with
approximate dual quaternion blending", 2008 (screw motions between poses);
A. Vlachos, J. Peters, C. Boyd, J. L. Mitchell, "Curved PN triangles", 2001
(curved triangles from what is known at their corners).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from sshade.carry.frames import in_rows
from sshade.carry.projection import Projection
from sshade.carry.vertex_maps import VertexMaps
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.rotations import fit_rotations, quaternions
from sshade.threads import ThreadTeam, in_ranges

#: How far R^T R of a given rotation may be from the identity.
ORTHOGONAL = 1e-6
#: Triangles whose frames a thread makes at a time.
ROWS = 4096

# What decoding needs of a triangle abc, side by side in memory, for a point reads all of it:
#
#   column      0     3     6     9      12     15     18    22    26    30
#   T[t]        | v_a'| v_b'| v_c'| b_bc | b_ca | b_ab | q_a | q_b | q_c |
#               CORNER            BULGE                QUATERNION
CORNER, BULGE, QUATERNION, WIDTH = 0, 9, 18, 30


@dataclass(frozen=True, eq=False)
class BlendedFrames:
    """Frames at a proxy's vertices, blended over its triangles.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    stretch : bool
        Frames turn and stretch as the edges around their vertex do; otherwise they only turn.
    """

    proxy: Mesh
    stretch: bool = False

    @cached_property
    def maps(self) -> VertexMaps:
        """Of N at rest; not needed where rotations are given."""
        return VertexMaps.at_rest(self.proxy)

    @property
    def name(self) -> str:
        """Of the kind, as users give it."""
        return "blended_affine" if self.stretch else "blended"

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Offsets x - p, p = sum_i w_i v_i; see :class:`sshade.carry.frames.Frames`."""
        local, given = np.empty_like(V), (V, on.face, on.barycentric, self.proxy.V, self.proxy.F)
        in_ranges(lambda first, end: _offsets(first, end, *given, local), len(V))
        return local

    def decode(
        self,
        local: np.ndarray,
        NV: np.ndarray,
        *,
        on: Projection,
        rotations: np.ndarray | None = None,
        team: ThreadTeam | None = None,
        out: np.ndarray | None = None,
    ) -> tuple[np.ndarray, int]:
        """Points o(w) + R(w) (x - p), or o(w) + R(w) S(w) (x - p); see :class:`sshade.carry.frames.Frames`.

        Rotations that are not given, and those of frames that stretch, are the ones nearest to
        the vertices' affine maps.

        Raises
        ------
        InputError
            When a matrix in `rotations` is not a rotation.
        """
        F, missing = self.proxy.F, 0
        if rotations is None or self.stretch:
            A, known = self.maps(NV)
            R = nearest_rotations(A)
            missing = int((~known).sum())
        else:
            R = np.ascontiguousarray(rotations, dtype=np.float64)
        Q, error = quaternions(R)
        if not error <= ORTHOGONAL:
            raise InputError(f"a rotation of the proxy's vertices is off by {error:.1e}: it is no rotation")
        triangles = np.empty((len(F), WIDTH))
        (team or ThreadTeam(1)).ranges(lambda *own: _triangles(*own, F, NV, Q, triangles), len(F), rows=ROWS)
        if self.stretch:
            S = np.ascontiguousarray(R.transpose(0, 2, 1) @ A)
            _add_stretch(triangles, F, self.proxy.V, Q, S)
            local = _stretched(local, on.face, on.barycentric, F, S)

        def decode(first: int, end: int, V: np.ndarray) -> None:
            _decode(first, end, local, on.face, on.barycentric, triangles, V)

        return in_rows(decode, len(local), team, out), missing


def nearest_rotations(A: np.ndarray) -> np.ndarray:
    """(k, 3, 3) rotations R that maximise tr(R^T A): the nearest ones to matrices (k, 3, 3)."""
    R = np.array(A.transpose(0, 2, 1), dtype=np.float64, order="C").reshape(-1, 9)
    fit_rotations(R, np.tile([1.0, 0.0, 0.0, 0.0], (len(A), 1)))
    return R.reshape(-1, 3, 3)


@njit(cache=True, nogil=True)
def _offsets(first, end, V, face, barycentric, NV, F, local):
    for i in range(first, end):
        a, b, c = F[face[i], 0], F[face[i], 1], F[face[i], 2]
        for r in range(3):
            p = barycentric[i, 0] * NV[a, r] + barycentric[i, 1] * NV[b, r] + barycentric[i, 2] * NV[c, r]
            local[i, r] = V[i, r] - p


@njit(cache=True, nogil=True)
def _triangles(first, end, F, V, Q, T):
    """Write rows of T (l, WIDTH) as above, with quaternions whose signs agree.

    A quaternion and its negative are the same rotation; the signs are chosen
    along the two edges with the smaller turns. Were they chosen along any two,
    opposite ones could meet on the third edge and cancel.
    """
    for t in range(first, end):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        for r in range(3):
            T[t, CORNER + r], T[t, CORNER + 3 + r], T[t, CORNER + 6 + r] = V[a, r], V[b, r], V[c, r]
        bc = _bulge(V, Q, b, c, T[t, BULGE : BULGE + 3])
        ca = _bulge(V, Q, c, a, T[t, BULGE + 3 : BULGE + 6])
        ab = _bulge(V, Q, a, b, T[t, BULGE + 6 : BULGE + 9])
        b_sign = 1.0 if ab >= 0.0 else -1.0
        c_sign = 1.0 if ca >= 0.0 else -1.0
        if abs(bc) > min(abs(ca), abs(ab)):
            if abs(ca) <= abs(ab):
                c_sign = b_sign if bc >= 0.0 else -b_sign
            else:
                b_sign = c_sign if bc >= 0.0 else -c_sign
        for r in range(4):
            T[t, QUATERNION + r] = Q[a, r]
            T[t, QUATERNION + 4 + r] = b_sign * Q[b, r]
            T[t, QUATERNION + 8 + r] = c_sign * Q[c, r]


@njit(cache=True, nogil=True)
def _bulge(V, Q, i, j, out):
    """Write b_ij; return the product of the quaternions, the cosine of half the angle between them."""
    iw, ix, iy, iz = Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3]
    jw, jx, jy, jz = Q[j, 0], Q[j, 1], Q[j, 2], Q[j, 3]
    cosine = iw * jw + ix * jx + iy * jy + iz * jz
    scale = 2.0 / (1.0 + abs(cosine))
    if cosine < 0.0:
        scale = -scale
    mx = scale * (iw * jx - jw * ix - jy * iz + jz * iy)
    my = scale * (iw * jy - jw * iy - jz * ix + jx * iz)
    mz = scale * (iw * jz - jw * iz - jx * iy + jy * ix)
    ex, ey, ez = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
    out[0], out[1], out[2] = ey * mz - ez * my, ez * mx - ex * mz, ex * my - ey * mx
    return cosine


@njit(cache=True, nogil=True)
def _add_stretch(T, F, rest, Q, S):
    """Add R (S_i - S_j) (v_j - v_i) / 2 to each b_ij, R the blend of R_i and R_j half-way."""
    q, g = np.empty(4), np.empty(3)
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
            T[t, BULGE + 3 * k] += x
            T[t, BULGE + 3 * k + 1] += y
            T[t, BULGE + 3 * k + 2] += z


@njit(cache=True, nogil=True)
def _turned(w, x, y, z, u, v, s):
    """The vector (u, v, s) turned by the quaternion (w, x, y, z) of any length."""
    n = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = n * (y * s - z * v), n * (z * u - x * s), n * (x * v - y * u)
    return u + w * tx + y * tz - z * ty, v + w * ty + z * tx - x * tz, s + w * tz + x * ty - y * tx


@njit(cache=True, nogil=True)
def _stretched(local, face, barycentric, F, S):
    """(n, 3) stretched offsets S(w) (x - p)."""
    result = np.empty_like(local)
    for i in range(len(local)):
        a, b, c = F[face[i], 0], F[face[i], 1], F[face[i], 2]
        wa, wb, wc = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        for r in range(3):
            u = wa * S[a, r, 0] + wb * S[b, r, 0] + wc * S[c, r, 0]
            v = wa * S[a, r, 1] + wb * S[b, r, 1] + wc * S[c, r, 1]
            w = wa * S[a, r, 2] + wb * S[b, r, 2] + wc * S[c, r, 2]
            result[i, r] = u * x + v * y + w * z
    return result


@njit(cache=True, nogil=True)
def _decode(first, end, local, face, barycentric, T, V):
    for i in range(first, end):
        t, a, b, c = face[i], barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        bc, ca, ab = b * c, c * a, a * b
        q = QUATERNION
        w = a * T[t, q] + b * T[t, q + 4] + c * T[t, q + 8]
        x = a * T[t, q + 1] + b * T[t, q + 5] + c * T[t, q + 9]
        y = a * T[t, q + 2] + b * T[t, q + 6] + c * T[t, q + 10]
        z = a * T[t, q + 3] + b * T[t, q + 7] + c * T[t, q + 11]
        V[i, 0], V[i, 1], V[i, 2] = _turned(w, x, y, z, local[i, 0], local[i, 1], local[i, 2])
        for r in range(3):
            p, s = CORNER + r, BULGE + r
            o = a * T[t, p] + b * T[t, p + 3] + c * T[t, p + 6]
            V[i, r] = o + bc * T[t, s] + ca * T[t, s + 3] + ab * T[t, s + 6] + V[i, r]
