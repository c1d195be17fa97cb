"""Struts: springs between opposite vertices, which keep the local thickness.

A surface does not know that it is a wall or a solid. It may pinch, or swell, at no cost but stretch. A strut
joins vertex i to the opposite vertex j, and costs

    weight (a_i / t^2) |(p_i - p_j) - R_i (v_i - v_j)|^2

beside the as-rigid-as-possible energy. The area of vertex i is a_i, t its distance from vertex j at rest, and
R_i its rotation, which both energies share. A relative change of the thickness costs as much as the same
strain of the surface, at any scale and resolution.

See :mod:`sshade.mesh.boxes` for opposite vertices.
"""

from __future__ import annotations

from copy import copy
from typing import Self

import numpy as np

from sshade.core.kernels import kernel
from sshade.mesh.boxes import opposite_vertices
from sshade.problem.options import Options
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh
from sshade.solver.terms.term import Term


class Struts(Term):
    """The struts; see :class:`sshade.solver.terms.term.Term`. No two struts have one first vertex.

    Parameters
    ----------
    ordered : OrderedMesh
    weight : float
        Option `thickness`.
    """

    option = "thickness"
    rigid = True
    _W: np.ndarray

    def __init__(self, ordered: OrderedMesh, weight: float) -> None:
        mesh = ordered.mesh
        self._ordered = ordered
        i, j = opposite_vertices(mesh, ordered.with_struts)
        order = np.argsort(ordered.place[i])
        i, j = i[order], j[order]
        self._first = ordered.place[i]
        self._second = ordered.place[j]
        self._rest = mesh.V[i] - mesh.V[j]
        self._stiffness = weight * mesh.vertex_areas[i] / np.einsum("pd,pd->p", self._rest, self._rest)
        self.rest_energy = ordered.corners * float((self._stiffness[:, None] * self._rest**2).sum())
        by_second = np.argsort(self._second, kind="stable")
        second = self._second[by_second]
        self._first_in = [tuple(np.searchsorted(self._first, own[1:])) for own in ordered.ranges]
        self._second_in = [by_second[slice(*np.searchsorted(second, own[1:]))] for own in ordered.ranges]

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        return cls(ordered, options.thickness) if options.thickness > 0 else None

    def with_handles(self, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self:
        return self

    def matrix(self, order: Order) -> np.ndarray:
        """Return the diagonal of the struts' matrix.

        The matrix would couple both sides of a limb, and multiply the entries of a factorisation. It is at
        most twice its diagonal, so that global steps with the diagonal still descend.
        """
        ends = np.concatenate([self._first, self._second])
        diagonal = np.bincount(ends, np.tile(self._stiffness, 2), self._ordered.mesh.n)
        return self._ordered.in_order(diagonal, order)

    def begun(self, options: Options) -> Self:
        term = copy(self)
        #: Strut vectors after the local step, then the forces of the struts.
        term._W = np.empty_like(self._rest)
        return term

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        arrays = self._first, self._second, self._stiffness, self._rest
        return _covariances(*arrays, float(self._ordered.corners), P, S, self._W, *self._first_in[number])

    def turn(self, number: int, R: np.ndarray) -> None:
        _turn(self._first, self._stiffness, self._rest, R, self._W, *self._first_in[number])

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        arrays = self._first, self._second, self._stiffness, self._second_in[number]
        return self._ordered.corners * _add_forces(*arrays, self._W, B, *self._first_in[number])


@kernel
def _covariances(first, second, stiffness, rest, corners, P, S, W, begin, end):
    """Write the vectors of a range of struts to W, and add their covariances to S; return their energy."""
    energy = 0.0
    for s in range(begin, end):
        i, j, k = first[s], second[s], corners * stiffness[s]
        x, y, z = P[i, 0] - P[j, 0], P[i, 1] - P[j, 1], P[i, 2] - P[j, 2]
        W[s, 0], W[s, 1], W[s, 2] = x, y, z
        for r in range(3):
            v = k * rest[s, r]
            S[i, 3 * r] += v * x
            S[i, 3 * r + 1] += v * y
            S[i, 3 * r + 2] += v * z
        energy += k * (x * x + y * y + z * z)
    return energy


@kernel
def _turn(first, stiffness, rest, R, W, begin, end):
    """Replace the vectors W of a range of struts by their forces on the first vertices."""
    for s in range(begin, end):
        i, k, x, y, z = first[s], stiffness[s], rest[s, 0], rest[s, 1], rest[s, 2]
        for r in range(3):
            W[s, r] = k * (R[i, 3 * r] * x + R[i, 3 * r + 1] * y + R[i, 3 * r + 2] * z - W[s, r])


@kernel
def _add_forces(first, second, stiffness, others, W, B, begin, end):
    """Add the forces of struts to both vertices; return the energy of those from `begin` to `end`."""
    energy = 0.0
    for s in range(begin, end):
        i = first[s]
        for c in range(3):
            B[i, c] += W[s, c]
            energy += W[s, c] * W[s, c] / stiffness[s]
    for s in others:
        j = second[s]
        for c in range(3):
            B[j, c] -= W[s, c]
    return energy
