"""The terms of an as-rigid-as-possible energy: what each adds to the local and to the global step.

A term is a small set of corners c with vectors y_c that add up to zero:

- spokes: an edge (i, j), y_i = w_ij (p_i - p_j);
- spokes and rims: a triangle, y_k = sum over its edges kl of h_kl (p_k - p_l).

It adds ``sum_c y_c q_c^T`` to the covariance S of each of its corners and ``M y_c``
to the right-hand side of corner c, M being the mean of its corners' rotations. Triangles may have weights,
by which both are multiplied; those that softening gives them, see :mod:`sshade.solver.strain_softening`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Terms(NamedTuple):
    """Edges of the energy.

    Attributes
    ----------
    corners : (e, 2) uint32
        Vertices of each; unsigned, as kernels then need no test for negative ones.
    Y : (e, 1, 3) float64
        y of the first corner; that of the second is minus it.
    H : (e, 1) float64
        Weights.
    """

    corners: np.ndarray
    Y: np.ndarray
    H: np.ndarray

    def part(self, own: slice) -> Terms:
        """Those of a slice."""
        return Terms(self.corners[own], self.Y[own], self.H[own])


class Triangles(NamedTuple):
    """Triangles of the energy; their y are computed from rest positions, a quarter of the memory.

    Attributes
    ----------
    corners : (m, 3) uint32
    V : (n, 3) float64
        Rest positions.
    H : (m, 3) float64
        Half cotangents of the edges 01, 12, 20.
    """

    corners: np.ndarray
    V: np.ndarray
    H: np.ndarray

    def part(self, own: slice) -> Triangles:
        """Those of a slice."""
        return Triangles(self.corners[own], self.V, self.H[own])


#: Weights of triangles that have none.
UNWEIGHTED = np.empty(0)


def covariances(
    terms: Terms | Triangles,
    P: np.ndarray,
    S: np.ndarray,
    first: int,
    end: int,
    *,
    weight: np.ndarray = UNWEIGHTED,
) -> float:
    """Write the covariances of the vertices from `first` to `end` to S.

    Calls for ranges that cover all vertices write the same bits as one for all, and
    may run at the same time.

    Parameters
    ----------
    terms : Terms or Triangles
        At least those that touch the vertices from `first` to `end`.
    P : (n, 3) float64
        Deformed positions.
    S : (n, 9) float64
        Row by row; only those of the range are written.
    first, end : int
    weight : (m,) float64, optional
        Of triangles.

    Returns
    -------
    float
        ``corners x sum_edges h |e'|^2`` of the terms whose lowest vertex is in the range, without weights.
    """
    if isinstance(terms, Triangles):
        return _triangle_covariances(*terms, weight, P, S, first, end)
    return _edge_covariances(*terms, P, S, first, end)


def right_hand_side(
    terms: Terms | Triangles,
    R: np.ndarray,
    B: np.ndarray,
    first: int,
    end: int,
    *,
    P: np.ndarray | None = None,
    kept: float = 1.0,
) -> None:
    """Write rows `first` to `end` of the global step's right-hand side, without what held vertices add.

    Parameters as of :func:`covariances`; R (n, 9) the rotation matrices, B (n, 3) float64.
    With L_t the Laplacian of a term, what is written has ``(kept - 1) L_t P`` besides: for `kept` = 0 all of
    B is minus half of the energy's gradient over the number of corners. P (n, 3) may be missing for 1.
    """
    P = B if P is None else P
    if isinstance(terms, Triangles):
        _triangle_right_hand_side(*terms, kept, P, R, B, first, end)
    else:
        _edge_right_hand_side(*terms, kept, P, R, B, first, end)


@njit(cache=True, nogil=True)
def _triangle_covariances(corners, V, H, weight, P, S, first, end):
    S[first:end] = 0.0
    energy, weighted = 0.0, len(weight) > 0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        w = weight[t] if weighted else 1.0
        h0, h1, h2 = w * H[t, 0], w * H[t, 1], w * H[t, 2]
        ax, ay, az = P[i, 0] - P[k, 0], P[i, 1] - P[k, 1], P[i, 2] - P[k, 2]
        bx, by, bz = P[j, 0] - P[k, 0], P[j, 1] - P[k, 1], P[j, 2] - P[k, 2]
        cx, cy, cz = ax - bx, ay - by, az - bz
        if min(i, j, k) >= first:
            energy += 3.0 * (
                H[t, 0] * (cx * cx + cy * cy + cz * cz)
                + H[t, 1] * (bx * bx + by * by + bz * bz)
                + H[t, 2] * (ax * ax + ay * ay + az * az)
            )
        for r in range(3):
            side = h0 * (V[i, r] - V[j, r])
            y, z = side + h2 * (V[i, r] - V[k, r]), h1 * (V[j, r] - V[k, r]) - side
            x0, x1, x2 = y * ax + z * bx, y * ay + z * by, y * az + z * bz
            for c in (i, j, k):
                if first <= c < end:
                    S[c, 3 * r] += x0
                    S[c, 3 * r + 1] += x1
                    S[c, 3 * r + 2] += x2
    return energy


@njit(cache=True, nogil=True)
def _edge_covariances(corners, Y, H, P, S, first, end):
    S[first:end] = 0.0
    energy = 0.0
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        ax, ay, az = P[i, 0] - P[j, 0], P[i, 1] - P[j, 1], P[i, 2] - P[j, 2]
        if min(i, j) >= first:
            energy += 2.0 * H[t, 0] * (ax * ax + ay * ay + az * az)
        for c in (i, j):
            if first <= c < end:
                for r in range(3):
                    y = Y[t, 0, r]
                    S[c, 3 * r] += y * ax
                    S[c, 3 * r + 1] += y * ay
                    S[c, 3 * r + 2] += y * az
    return energy


@njit(cache=True, nogil=True)
def _triangle_right_hand_side(corners, V, H, kept, P, R, B, first, end):
    B[first:end] = 0.0
    third, stay = 1.0 / 3.0, kept - 1.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        h0, h1, h2 = H[t, 0], H[t, 1], H[t, 2]
        # The edges 01, 12, 20 at rest.
        ux, uy, uz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
        vx, vy, vz = V[j, 0] - V[k, 0], V[j, 1] - V[k, 1], V[j, 2] - V[k, 2]
        wx, wy, wz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        ux, uy, uz = h0 * ux, h0 * uy, h0 * uz
        yx, yy, yz = ux - h2 * wx, uy - h2 * wy, uz - h2 * wz
        zx, zy, zz = h1 * vx - ux, h1 * vy - uy, h1 * vz - uz
        for r in range(3):
            a = third * (R[i, 3 * r] + R[j, 3 * r] + R[k, 3 * r])
            b = third * (R[i, 3 * r + 1] + R[j, 3 * r + 1] + R[k, 3 * r + 1])
            c = third * (R[i, 3 * r + 2] + R[j, 3 * r + 2] + R[k, 3 * r + 2])
            at_i = a * yx + b * yy + c * yz
            at_j = a * zx + b * zy + c * zz
            if stay != 0.0:
                ij, jk, ki = P[i, r] - P[j, r], P[j, r] - P[k, r], P[k, r] - P[i, r]
                at_i += stay * (h0 * ij - h2 * ki)
                at_j += stay * (h1 * jk - h0 * ij)
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] += at_j
            if first <= k < end:
                B[k, r] -= at_i + at_j


@njit(cache=True, nogil=True)
def _edge_right_hand_side(corners, Y, H, kept, P, R, B, first, end):
    B[first:end] = 0.0
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        stay = (kept - 1.0) * H[t, 0]
        for r in range(3):
            a = 0.5 * (R[i, 3 * r] + R[j, 3 * r])
            b = 0.5 * (R[i, 3 * r + 1] + R[j, 3 * r + 1])
            c = 0.5 * (R[i, 3 * r + 2] + R[j, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2]
            if stay != 0.0:
                at_i += stay * (P[i, r] - P[j, r])
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] -= at_i


@njit(cache=True, nogil=True)
def pulling_energy(place, pull, share, towards, P):
    """Return ``sum share_i pull_i |P_i - towards_i|^2`` over the vertices at `place` (j,)."""
    total = 0.0
    for j in range(len(place)):
        i = place[j]
        x, y, z = P[i, 0] - towards[j, 0], P[i, 1] - towards[j, 1], P[i, 2] - towards[j, 2]
        total += share[j] * pull[j] * (x * x + y * y + z * z)
    return total


@njit(cache=True, nogil=True)
def add_pulls(place, pull, share, towards, kept, P, B):
    """Add ``pull_i (share_i towards_i + (kept - share_i) P_i)`` to B (n, 3), for vertices at `place` (j,)."""
    for j in range(len(place)):
        i, w = place[j], share[j]
        for c in range(3):
            B[i, c] += pull[j] * (w * towards[j, c] + (kept - w) * P[i, c])
