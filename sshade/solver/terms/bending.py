"""Bending: an energy of curvature beside the as-rigid-as-possible energy.

A membrane resists stretch but hardly any bending. It folds along a line where handles clamp a region or
strain gathers. Folds are sharper on finer meshes. The bending energy of vertex i is

    (l^2 / a_i) |(L p)_i - R_i (L v)_i|^2,

with the cotangent Laplacian L of the rest shape v, the area a_i of the vertex, and the rotation R_i, which is
shared with the as-rigid-as-possible energy. (L v)_i / a_i is twice the normal times the mean curvature.
Sharp folds therefore cost more, and a fold is spread over about the length l on any mesh. Fixed vertices
beside movable ones also have the energy. If their other neighbours are fixed, they fix the slope at the
edge of a handle region, as in a clamped plate. Vertices on a free boundary have none, because (L v)_i is no
curvature there: functions that are harmonic up to the boundary cost nothing.

The local step fits R_i to the covariances of both energies, and the global step has the matrix ``L + L D L``
with the diagonal D of l^2 / a_i, or a V-cycle for it. Neither step raises the energy.

M. Botsch, L. Kobbelt, "An intuitive framework for real-time freeform modeling", 2004 (regions with a
slope at their edges); M. Wardetzky, M. Bergou, D. Harmon, D. Zorin, E. Grinspun, "Discrete quadratic
curvature energies", 2007 (the squared Laplacian as bending energy).
"""

from __future__ import annotations

from copy import copy
from typing import Self

import numpy as np
from scipy.sparse import csr_array, diags_array

from sshade.core.kernels import kernel
from sshade.mesh.mesh import Mesh
from sshade.problem.options import Options
from sshade.solver.multigrid import compressed_rows
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh
from sshade.solver.terms.term import Term

#: Sum of a vertex's absolute weights beyond which its energy fades. (L v)_i of slivers is no curvature.
STEEP = 20.0
#: Least area of a vertex, as a fraction of the mean, for the same reason.
LEAST_AREA = 0.01


def bending_stiffness(mesh: Mesh, laplacian: csr_array, fixed: np.ndarray, length: float) -> np.ndarray:
    """Compute l^2 / a_i for each vertex.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    laplacian : (n, n) csr_array
        L.
    fixed : (h,) int
        Fixed vertices. A fixed vertex with fixed neighbours has no energy.
    length : float
        l, in the mesh's unit.

    Returns
    -------
    (n,) float64
        0 also on the boundary.
    """
    size, movable = abs(laplacian), np.ones(mesh.n)
    movable[fixed] = 0.0
    area = np.maximum(mesh.vertex_areas, LEAST_AREA * mesh.area / mesh.n)
    weights = np.asarray(size.sum(axis=1)) / 2
    stiffness = length**2 / area * (STEEP / np.maximum(weights, STEEP)) ** 2
    stiffness[mesh.boundary_edges.ravel()] = 0.0
    stiffness[size @ movable == 0.0] = 0.0
    return stiffness


def bending_matrix(laplacian: csr_array, stiffness: np.ndarray) -> csr_array:
    """Return ``L D L`` with the diagonal D of the stiffness (n,)."""
    some = np.flatnonzero(stiffness)
    rows = laplacian[some]
    return csr_array(rows.T @ (diags_array(stiffness[some]) @ rows))


class Bending(Term):
    """The bending energy; see :class:`sshade.solver.terms.term.Term`.

    Parameters
    ----------
    ordered : OrderedMesh
    fixed : (h,) int
        Fixed vertices of the mesh.
    length : float
        Option `bending`: l, as a fraction of the square root of the mesh's area.
    """

    option = "bending"
    rigid = True
    _W: np.ndarray

    def __init__(self, ordered: OrderedMesh, fixed: np.ndarray, length: float) -> None:
        mesh, laplacian = ordered.mesh, ordered.laplacian
        self._ordered = ordered
        self._stiffness_in_mesh = bending_stiffness(
            mesh, laplacian, fixed, length * float(np.sqrt(mesh.area))
        )
        self._stiffness = self._stiffness_in_mesh[ordered.vertex]
        self._laplacian = laplacian[ordered.vertex][:, ordered.vertex]
        self._laplacian.sort_indices()
        self._rest = self._laplacian @ (mesh.V - mesh.origin)[ordered.vertex]
        # No dot product: BLAS would start threads that spin for a while beside ours.
        self.rest_energy = ordered.corners * float((self._stiffness[:, None] * self._rest**2).sum())
        self._rows = compressed_rows(self._laplacian)

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        fixed = handles.index[handles.hard]
        return cls(ordered, fixed, options.bending) if options.bending > 0 else None

    def matrix(self, order: Order) -> csr_array:
        if order == "mesh":
            return bending_matrix(self._ordered.laplacian, self._stiffness_in_mesh)
        return bending_matrix(self._laplacian, self._stiffness)

    def begun(self, options: Options) -> Self:
        term = copy(self)
        #: L P after the local step, and D (R L v - L P) after the rotation fit.
        term._W = np.empty_like(self._rest)
        return term

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        _, first, end = self._ordered.ranges[number]
        weight = float(self._ordered.corners)
        return _covariances(*self._rows, self._stiffness, self._rest, weight, P, S, self._W, first, end)

    def turn(self, number: int, R: np.ndarray) -> None:
        _, first, end = self._ordered.ranges[number]
        _turn(self._stiffness, self._rest, R, self._W, first, end)

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        _, first, end = self._ordered.ranges[number]
        return self._ordered.corners * _add_forces(*self._rows, self._stiffness, self._W, B, first, end)


@kernel(fastmath={"contract"})
def _covariances(start, column, value, stiffness, rest, weight, P, S, W, first, end):
    """Add covariances to S and write L P to W; return ``weight sum stiffness |(L P)_i|^2``."""
    energy = 0.0
    for i in range(first, end):
        if stiffness[i] == 0.0:
            continue
        x = y = z = 0.0
        for k in range(start[i], start[i + 1]):
            j, v = column[k], value[k]
            x += v * P[j, 0]
            y += v * P[j, 1]
            z += v * P[j, 2]
        W[i, 0], W[i, 1], W[i, 2] = x, y, z
        w = weight * stiffness[i]
        energy += w * (x * x + y * y + z * z)
        for r in range(3):
            S[i, 3 * r] += w * rest[i, r] * x
            S[i, 3 * r + 1] += w * rest[i, r] * y
            S[i, 3 * r + 2] += w * rest[i, r] * z
    return energy


@kernel(fastmath={"contract"})
def _turn(stiffness, rest, R, W, first, end):
    """Replace L P in W by ``stiffness (R rest - L P)``."""
    for i in range(first, end):
        for r in range(3):
            if stiffness[i] == 0.0:
                W[i, r] = 0.0
                continue
            x = R[i, 3 * r] * rest[i, 0] + R[i, 3 * r + 1] * rest[i, 1] + R[i, 3 * r + 2] * rest[i, 2]
            W[i, r] = stiffness[i] * (x - W[i, r])


@kernel(fastmath={"contract"})
def _add_forces(start, column, value, stiffness, W, B, first, end):
    """Add L W to rows of B; return the energy ``sum |W_i|^2 / stiffness_i``."""
    energy = 0.0
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
        if stiffness[i] > 0.0:
            energy += (W[i, 0] * W[i, 0] + W[i, 1] * W[i, 1] + W[i, 2] * W[i, 2]) / stiffness[i]
    return energy
