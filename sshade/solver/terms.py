"""The terms of an as-rigid-as-possible energy: what each adds to the local and to the global step.

A term is a small set of corners c with vectors y_c that add up to zero:

- spokes: an edge (i, j), y_i = w_ij (p_i - p_j);
- spokes and rims: a triangle, y_k = sum over its edges kl of h_kl (p_k - p_l).

It adds ``sum_c y_c q_c^T`` to the covariance S of each of its corners and ``M y_c``
to the right-hand side of corner c, M being the mean of its corners' rotations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Terms(NamedTuple):
    """Edges or triangles of the energy.

    Attributes
    ----------
    corners : (e, 2) or (e, 3) uint32
        Vertices of each; unsigned, as kernels then need no test for negative ones.
    Y : (e, 1, 3) or (e, 2, 3) float64
        y of all corners but the last, whose y is minus their sum.
    H : (e, 1) or (e, 3) float64
        Weights of the edges 01, 12, 20.
    """

    corners: np.ndarray
    Y: np.ndarray
    H: np.ndarray

    def part(self, own: slice) -> Terms:
        """Those of a slice."""
        return Terms(self.corners[own], self.Y[own], self.H[own])


def covariances(terms: Terms, P: np.ndarray, S: np.ndarray, first: int, end: int) -> float:
    """Write the covariances of the vertices from `first` to `end` to S.

    Calls for ranges that cover all vertices write the same bits as one for all, and
    may run at the same time.

    Parameters
    ----------
    terms : Terms
        At least those that touch the vertices from `first` to `end`.
    P : (n, 3) float64
        Deformed positions.
    S : (n, 9) float64
        Row by row; only those of the range are written.
    first, end : int

    Returns
    -------
    float
        ``corners x sum_edges h |e'|^2`` of the terms whose lowest vertex is in the range.
    """
    kernel = _triangle_covariances if terms.corners.shape[1] == 3 else _edge_covariances
    return kernel(*terms, P, S, first, end)


def right_hand_side(terms: Terms, R: np.ndarray, B: np.ndarray, first: int, end: int) -> None:
    """Write rows `first` to `end` of the global step's right-hand side, without what held vertices add.

    Parameters as of :func:`covariances`; R (n, 9) the rotation matrices, B (n, 3) float64.
    """
    kernel = _triangle_right_hand_side if terms.corners.shape[1] == 3 else _edge_right_hand_side
    kernel(terms.corners, terms.Y, R, B, first, end)


@njit(cache=True, nogil=True)
def _triangle_covariances(corners, Y, H, P, S, first, end):
    S[first:end] = 0.0
    energy = 0.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        ax, ay, az = P[i, 0] - P[k, 0], P[i, 1] - P[k, 1], P[i, 2] - P[k, 2]
        bx, by, bz = P[j, 0] - P[k, 0], P[j, 1] - P[k, 1], P[j, 2] - P[k, 2]
        cx, cy, cz = ax - bx, ay - by, az - bz
        if min(i, j, k) >= first:
            energy += 3.0 * (
                H[t, 0] * (cx * cx + cy * cy + cz * cz)
                + H[t, 1] * (bx * bx + by * by + bz * bz)
                + H[t, 2] * (ax * ax + ay * ay + az * az)
            )
        for c in (i, j, k):
            if first <= c < end:
                for r in range(3):
                    y, z = Y[t, 0, r], Y[t, 1, r]
                    S[c, 3 * r] += y * ax + z * bx
                    S[c, 3 * r + 1] += y * ay + z * by
                    S[c, 3 * r + 2] += y * az + z * bz
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
def _triangle_right_hand_side(corners, Y, R, B, first, end):
    B[first:end] = 0.0
    third = 1.0 / 3.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        for r in range(3):
            a = third * (R[i, 3 * r] + R[j, 3 * r] + R[k, 3 * r])
            b = third * (R[i, 3 * r + 1] + R[j, 3 * r + 1] + R[k, 3 * r + 1])
            c = third * (R[i, 3 * r + 2] + R[j, 3 * r + 2] + R[k, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2]
            at_j = a * Y[t, 1, 0] + b * Y[t, 1, 1] + c * Y[t, 1, 2]
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] += at_j
            if first <= k < end:
                B[k, r] -= at_i + at_j


@njit(cache=True, nogil=True)
def _edge_right_hand_side(corners, Y, R, B, first, end):
    B[first:end] = 0.0
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        for r in range(3):
            a = 0.5 * (R[i, 3 * r] + R[j, 3 * r])
            b = 0.5 * (R[i, 3 * r + 1] + R[j, 3 * r + 1])
            c = 0.5 * (R[i, 3 * r + 2] + R[j, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2]
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
def add_pulls(place, pull, share, towards, P, B):
    """Add to B (n, 3) ``pull_i (share_i towards_i + (1 - share_i) P_i)`` of the vertices at `place` (j,)."""
    for j in range(len(place)):
        i, w = place[j], share[j]
        for c in range(3):
            B[i, c] += pull[j] * (w * towards[j, c] + (1.0 - w) * P[i, c])
