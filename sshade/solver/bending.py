"""Bending: an energy of curvature beside that of an as-rigid-as-possible system.

A membrane resists stretch and hardly anything else. Where a region holds it, or strain gathers, it folds
along a line, the more sharply the finer the mesh. Here each vertex i adds

    (l^2 / a_i) |(L p)_i - R_i (L v)_i|^2

beside ``sum_ij w_ij |e'_ij - R_i e_ij|^2``: L is the cotangent Laplacian of the rest shape v, a_i the area of
the vertex, R_i its rotation, one for both terms. (L v)_i / a_i is twice the normal of mean curvature, so
that a fold costs the more, the shorter it is, and is spread over about the length l, on any mesh. Held
vertices beside free ones add their term, too: with their other neighbours held, that holds the slope at the
edge of a region as well as the place, as a plate that is clamped. On a free boundary there is no term,
as (L v)_i is no curvature there: functions that are harmonic up to it cost nothing.

The local step fits R_i to the covariances of both terms, the global step has the matrix ``L + L D L``, D the
diagonal of l^2 / a_i. So neither raises the energy, and quasi-Newton steps are as sound as without.

M. Botsch, L. Kobbelt, "An intuitive framework for real-time freeform modeling", 2004 (edges of
regions with a slope); M. Wardetzky, M. Bergou, D. Harmon, D. Zorin, E. Grinspun, "Discrete quadratic
curvature energies", 2007 (the squared Laplacian as an energy of bending).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csr_array, diags_array

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.multigrid import compressed_rows

#: Sum of a vertex's absolute weights beyond which its term fades: of slivers, whose (L v)_i is no curvature.
STEEP = 20.0
#: Least area of a vertex, over the mean, for the same reason.
LEAST_AREA = 0.01


def shares(mesh: Mesh, laplacian: csr_array, held: np.ndarray, length: float) -> np.ndarray:
    """l^2 / a_i of each vertex.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    laplacian : (n, n) csr_array
        L.
    held : (h,) int
        Vertices that are held. One whose neighbours are held, too, adds nothing.
    length : float
        l, in the mesh's unit.

    Returns
    -------
    (n,) float64
        0 also on the boundary, where (L v)_i is no curvature: a free edge.

    Raises
    ------
    InputError
        On a length that is negative or not finite.
    """
    if not 0 <= length < np.inf:
        raise InputError(f"the length of bending must be at least 0 and finite, not {length}")
    size, free = abs(laplacian), np.ones(mesh.n)
    free[held] = 0.0
    area = np.maximum(mesh.vertex_areas, LEAST_AREA * mesh.area / mesh.n)
    weights = np.asarray(size.sum(axis=1)) / 2
    share = length**2 / area * (STEEP / np.maximum(weights, STEEP)) ** 2
    share[mesh.boundary_edges.ravel()] = 0.0
    share[size @ free == 0.0] = 0.0
    return share


def bending_matrix(laplacian: csr_array, share: np.ndarray) -> csr_array:
    """``L D L``, D the diagonal of shares (n,)."""
    some = np.flatnonzero(share)
    rows = laplacian[some]
    return csr_array(rows.T @ (diags_array(share[some]) @ rows))


class Bending(NamedTuple):
    """The terms of all vertices, in any order of these. P, W and B are (n, 3), S and R (n, 9) float64.

    Attributes
    ----------
    start, column, value
        L: see :func:`sshade.solver.multigrid.compressed_rows`.
    share : (n,) float64
        See :func:`shares`.
    rest : (n, 3) float64
        L v.
    weight : float
        Of all terms, 2 or 3: the energies of spokes, and of spokes and rims, count each edge as often.
    """

    start: np.ndarray
    column: np.ndarray
    value: np.ndarray
    share: np.ndarray
    rest: np.ndarray
    weight: float

    @classmethod
    def of(cls, laplacian: csr_array, share: np.ndarray, V: np.ndarray, weight: float) -> Bending:
        """From L (n, n) and rest positions (n, 3)."""
        return cls(*compressed_rows(laplacian), share, np.asarray(laplacian @ V), weight)

    @property
    def laplacian(self) -> csr_array:
        """L (n, n)."""
        n = len(self.share)
        return csr_array((self.value, self.column.view(np.int32), self.start.view(np.int32)), shape=(n, n))

    @property
    def rest_energy(self) -> float:
        """Of all vertices in one point; unit length^2."""
        return self.weight * float(self.share @ (self.rest**2).sum(axis=1))

    def add_covariances(self, P: np.ndarray, S: np.ndarray, first: int, end: int) -> float:
        """Add those of the vertices from `first` to `end` to S; return ``weight sum share |(L P)_i|^2``."""
        return _covariances(*self, P, S, first, end)

    def energy(self, P: np.ndarray, R: np.ndarray, first: int, end: int) -> float:
        """That of the vertices from `first` to `end`."""
        return _energy(*self, P, R, first, end)

    def turn(self, R: np.ndarray, W: np.ndarray, first: int, end: int) -> None:
        """Write ``share R L v`` of the vertices from `first` to `end` to W."""
        _turn(self.share, self.rest, R, W, first, end)

    def add_product(self, W: np.ndarray, B: np.ndarray, first: int, end: int) -> None:
        """Add L W to the rows `first` to `end` of B."""
        _add_product(self.start, self.column, self.value, W, B, first, end)


@njit(cache=True, nogil=True)
def _covariances(start, column, value, share, rest, weight, P, S, first, end):
    energy = 0.0
    for i in range(first, end):
        if share[i] == 0.0:
            continue
        x = y = z = 0.0
        for k in range(start[i], start[i + 1]):
            j, v = column[k], value[k]
            x += v * P[j, 0]
            y += v * P[j, 1]
            z += v * P[j, 2]
        w = weight * share[i]
        energy += w * (x * x + y * y + z * z)
        for r in range(3):
            S[i, 3 * r] += w * rest[i, r] * x
            S[i, 3 * r + 1] += w * rest[i, r] * y
            S[i, 3 * r + 2] += w * rest[i, r] * z
    return energy


@njit(cache=True, nogil=True)
def _energy(start, column, value, share, rest, weight, P, R, first, end):
    energy = 0.0
    for i in range(first, end):
        if share[i] == 0.0:
            continue
        a, b, c = rest[i, 0], rest[i, 1], rest[i, 2]
        x = -(R[i, 0] * a + R[i, 1] * b + R[i, 2] * c)
        y = -(R[i, 3] * a + R[i, 4] * b + R[i, 5] * c)
        z = -(R[i, 6] * a + R[i, 7] * b + R[i, 8] * c)
        for k in range(start[i], start[i + 1]):
            j, v = column[k], value[k]
            x += v * P[j, 0]
            y += v * P[j, 1]
            z += v * P[j, 2]
        energy += weight * share[i] * (x * x + y * y + z * z)
    return energy


@njit(cache=True, nogil=True)
def _turn(share, rest, R, W, first, end):
    for i in range(first, end):
        for r in range(3):
            x = R[i, 3 * r] * rest[i, 0] + R[i, 3 * r + 1] * rest[i, 1] + R[i, 3 * r + 2] * rest[i, 2]
            W[i, r] = share[i] * x


@njit(cache=True, nogil=True)
def _add_product(start, column, value, W, B, first, end):
    for i in range(first, end):
        x = y = z = 0.0
        for k in range(start[i], start[i + 1]):
            j, v = column[k], value[k]
            x += v * W[j, 0]
            y += v * W[j, 1]
            z += v * W[j, 2]
        B[i, 0] += x
        B[i, 1] += y
        B[i, 2] += z
