"""Blended frames: a frame at each vertex of the proxy, blended over its triangles.

Vertex i of N has a pose: its deformed position v_i' and its rotation R_i. A point x of M is projected to
p = w_a v_a + w_b v_b + w_c v_c on triangle (a, b, c) and keeps its offset x - p. Its deformed position is

    x' = o(w) + R(w) (x - p),
    o(w) = sum_i w_i v_i' + sum_{i<j} w_i w_j b_ij .

R(w) is the normalised blend of the quaternions at the corners. o(w) is a quadratic triangle. The middle of
each of its edges is the middle of the screw motion from the pose of one end to the pose of the other: with
c and m the scalar and the vector part of the quaternion of R_j R_i^T,

    b_ij = 2 (v_j' - v_i') x m / (1 + c) .

Properties:

- x' is continuous across edges, because on an edge only the poses of its two ends matter.
- Samples are exact. Rigid motions are exact, because equal rotations give b = 0.
- A bent edge becomes an arc: to second order b_ij = (R_i - R_j) (v_j - v_i) / 2, as in a quadratic map with
  these rotations. A weighted sum of the motions x -> v_i' + R_i (x - v_i) has twice this b and bulges twice
  as far as the arc.
- A twist keeps its cross-section. A weighted sum of matrices collapses onto the axis where N turns by half a
  turn from one vertex to the next (the candy wrapper). The screw motion goes around the axis, the shorter
  way.

Limits: at exactly half a turn both ways are equally short. Rotations fitted to the edges around a vertex see
only a part of a twist between two vertices. If the corners of a triangle turn by more than a full turn in
total, R(w) jumps at one of its edges; o(w) does not.

Sources: L. Kavan, S. Collins, J. Zara, C. O'Sullivan, "Geometric skinning with approximate dual quaternion
blending", 2008 (screw motions between poses); A. Vlachos, J. Peters, C. Boyd, J. L. Mitchell, "Curved PN
triangles", 2001 (curved triangles from data at their corners).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from sshade.core.errors import InputError
from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import ThreadTeam, in_ranges
from sshade.mesh.mesh import Mesh
from sshade.mesh.rotations import fit_rotations, quaternions
from sshade.proxy.frames import Frames, Placer
from sshade.proxy.projection import Projection
from sshade.proxy.vertex_maps import VertexMaps

#: Largest deviation of R^T R from the identity for a prescribed rotation R.
ORTHOGONAL = 1e-6
#: Number of triangles that a thread treats at a time.
ROWS = 4096

# Each point reads all data of its triangle abc. They stand side by side in memory, in a row of T (l, WIDTH):
#
#   column      0     3     6     9      12     15     18    22    26    30
#   T[t]        | v_a'| v_b'| v_c'| b_bc | b_ca | b_ab | q_a | q_b | q_c |
#               CORNER            BULGE                QUATERNION
CORNER, BULGE, QUATERNION, WIDTH = 0, 9, 18, 30


@dataclass(frozen=True, eq=False)
class BlendedFrames(Frames):
    """Frames at a proxy's vertices, blended over its triangles.

    Parameters
    ----------
    proxy : Mesh
        N at rest.
    """

    name: ClassVar[str] = "blended"  # type: ignore[misc]

    proxy: Mesh

    @cached_property
    def maps(self) -> VertexMaps:
        """Maps of the 1-rings of N at rest; not needed for prescribed rotations."""
        return VertexMaps.at_rest(self.proxy)

    def encode(self, V: np.ndarray, on: Projection) -> np.ndarray:
        """Return the offsets x - p; see :class:`sshade.proxy.frames.Frames`."""
        local, F, NV = np.empty_like(V), self.proxy.F, self.proxy.V
        in_ranges(_offsets, len(V), V, on.face, on.barycentric, NV, F, local)
        return local

    def posed(self, NV: np.ndarray, rotations: np.ndarray | None, team: ThreadTeam) -> tuple[Placer, int]:
        """Place points at o(w) + R(w) (x - p).

        Without `rotations`, R_i is the rotation nearest to the affine map of the edges around vertex i. See
        also :class:`sshade.proxy.frames.Frames`.

        Raises
        ------
        InputError
            If a matrix in `rotations` is not a rotation.
        """
        missing = 0
        if rotations is None:
            A, known = self.maps(NV)
            rotations = nearest_rotations(A)
            missing = int((~known).sum())
        triangles, _ = posed_triangles(self.proxy.F, NV, rotations, team)

        def place(first: int, end: int, local: np.ndarray, on: Projection, V: np.ndarray) -> None:
            place_blended(first, end, local, on.face, on.barycentric, triangles, V)

        return place, missing


def posed_triangles(
    F: np.ndarray, NV: np.ndarray, R: np.ndarray, team: ThreadTeam
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows T (l, :data:`WIDTH`) of triangles of N', and the quaternions (k, 4) of its vertices.

    Raises
    ------
    InputError
        If a matrix in R (k, 3, 3) is not a rotation.
    """
    Q, error = quaternions(np.ascontiguousarray(R, dtype=np.float64))
    if not error <= ORTHOGONAL:
        raise InputError(f"a rotation of the proxy's vertices is off by {error:.1e}: it is no rotation")
    triangles = np.empty((len(F), WIDTH))
    team.ranges(_triangles, len(F), F, NV, Q, triangles, rows=ROWS)
    return triangles, Q


def nearest_rotations(A: np.ndarray) -> np.ndarray:
    """Return the rotations R (k, 3, 3) nearest to matrices A (k, 3, 3): they maximise tr(R^T A).

    :func:`sshade.mesh.rotations.fit_rotations` maximises tr(R S) instead, hence S = A^T.
    """
    R = np.array(A.transpose(0, 2, 1), dtype=np.float64, order="C").reshape(-1, 9)
    fit_rotations(R, np.tile([1.0, 0.0, 0.0, 0.0], (len(A), 1)))
    return R.reshape(-1, 3, 3)


@kernel
def _offsets(first, end, V, face, barycentric, NV, F, local):
    for i in range(first, end):
        a, b, c = F[face[i], 0], F[face[i], 1], F[face[i], 2]
        for r in range(3):
            p = barycentric[i, 0] * NV[a, r] + barycentric[i, 1] * NV[b, r] + barycentric[i, 2] * NV[c, r]
            local[i, r] = V[i, r] - p


@kernel(fastmath={"contract"})
def _triangles(first, end, F, V, Q, T):
    """Write rows of T (l, WIDTH), with quaternions whose signs agree.

    A quaternion and its negative are the same rotation. Signs are chosen along the two edges with the
    smallest turns. Along two other edges, opposite quaternions could meet on the third edge and cancel.
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


@subroutine
def _bulge(V, Q, i, j, out):
    """Write b_ij to `out`; return the product of the quaternions, the cosine of half their relative turn."""
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


@subroutine
def _turned(w, x, y, z, u, v, s):
    """Rotate the vector (u, v, s) by the quaternion (w, x, y, z) of any length."""
    n = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = n * (y * s - z * v), n * (z * u - x * s), n * (x * v - y * u)
    return u + w * tx + y * tz - z * ty, v + w * ty + z * tx - x * tz, s + w * tz + x * ty - y * tx


@kernel(fastmath={"contract"})
def place_blended(first, end, local, face, barycentric, T, V):
    """Write o(w) + R(w) local_i for points i, with rows T (l, WIDTH) of :func:`posed_triangles`."""
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
