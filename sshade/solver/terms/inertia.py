"""Inertia: what no handle moves stays with the majority motion of the handles.

A body that leans costs almost no elastic energy, so that torso and thighs sway between the handles. The term

    weight sum_i (a_i / A) |p_i - g(v_i)|^2 / (1 + |p_i - g(v_i)|^2 / r^2)

beside the as-rigid-as-possible energy pulls the surface towards the motion g of most handle groups
(:mod:`sshade.problem.majority`), and lets go of what must move farther than the reach r. The area of vertex i
is a_i, and A the area of the whole mesh.

The energy is concave in the squared distance x. The quadratic energy with each vertex weighted by the
derivative ``1 / (1 + x / r^2)^2`` therefore lies above it and touches it, and no step raises it. The weights
are at most 1, so that the matrix has the stiffness ``weight a_i / A`` for all targets (half-quadratic
minimisation, as of :mod:`sshade.solver.terms.arap`).

S. Geman, D. E. McClure, "Statistical methods for tomographic image reconstruction", 1987.
"""

from __future__ import annotations

from typing import Self

import numpy as np

from sshade.core.kernels import kernel
from sshade.problem.options import Options
from sshade.solver.aim import Aim
from sshade.solver.bound_handles import BoundHandles
from sshade.solver.ordered_mesh import Order, OrderedMesh
from sshade.solver.terms.term import Term


class Inertia(Term):
    """The inertia; see :class:`sshade.solver.terms.term.Term`.

    Parameters
    ----------
    ordered : OrderedMesh
        Of the mesh, or of a piece of it.
    fixed : (h,) int
        Places of the hard handles, which have none.
    weight : float
        Option `inertia`.
    """

    option = "inertia"
    rigid = False

    def __init__(self, ordered: OrderedMesh, fixed: np.ndarray, weight: float) -> None:
        mesh, self._ordered = ordered.mesh, ordered
        self._stiffness = (weight * mesh.vertex_areas / mesh.area)[ordered.vertex]
        self._stiffness[fixed] = 0.0
        self._rest = (mesh.V - mesh.origin)[ordered.vertex]

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        return cls(ordered, handles.fixed, options.inertia) if options.inertia > 0 else None

    def matrix(self, order: Order) -> np.ndarray:
        return self._ordered.in_order(self._stiffness, order)

    def aim(self, aim: Aim) -> None:
        """Take the majority motion; without one the term is off."""
        self._fraction, self._per_square, self._R, self._t = 0.0, 1.0, np.eye(3), np.zeros(3)
        if (majority := aim.majority) is not None:
            mesh = self._ordered.mesh
            # A piece counts by its part of the area. Both sides of a one-sided surface count once.
            self._fraction = majority.certainty * min(1.0, mesh.area / majority.area)
            self._per_square, self._R = majority.reach**-2, np.ascontiguousarray(majority.rotation)
            self._t = majority.moved(mesh.origin[None])[0] - mesh.origin

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        return self._ordered.corners * self._fraction * _energy(*self._arguments(number, P))

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        energy = _add_forces(*self._arguments(number, P), self._fraction, B)
        return self._ordered.corners * self._fraction * energy

    def _arguments(self, number: int, P: np.ndarray) -> tuple[object, ...]:
        _, first, end = self._ordered.ranges[number]
        return self._stiffness, self._rest, self._R, self._t, self._per_square, P, first, end


@kernel(fastmath={"contract"})
def _energy(stiffness, rest, R, t, per_square, P, first, end):
    """Return ``sum stiffness_i x_i / (1 + x_i per_square)`` with ``x_i = |P_i - (R rest_i + t)|^2``."""
    total = 0.0
    for i in range(first, end):
        x = 0.0
        for r in range(3):
            goal = R[r, 0] * rest[i, 0] + R[r, 1] * rest[i, 1] + R[r, 2] * rest[i, 2] + t[r]
            x += (P[i, r] - goal) ** 2
        total += stiffness[i] * x / (1.0 + x * per_square)
    return total


@kernel(fastmath={"contract"})
def _add_forces(stiffness, rest, R, t, per_square, P, first, end, fraction, B):
    """Add ``fraction stiffness_i (R rest_i + t - P_i) / (1 + x_i per_square)^2`` to B_i; return energy."""
    total = 0.0
    for i in range(first, end):
        a = R[0, 0] * rest[i, 0] + R[0, 1] * rest[i, 1] + R[0, 2] * rest[i, 2] + t[0] - P[i, 0]
        b = R[1, 0] * rest[i, 0] + R[1, 1] * rest[i, 1] + R[1, 2] * rest[i, 2] + t[1] - P[i, 1]
        c = R[2, 0] * rest[i, 0] + R[2, 1] * rest[i, 1] + R[2, 2] * rest[i, 2] + t[2] - P[i, 2]
        x = a * a + b * b + c * c
        kept = 1.0 / (1.0 + x * per_square)
        total += stiffness[i] * x * kept
        pull = fraction * stiffness[i] * kept * kept
        B[i, 0] += pull * a
        B[i, 1] += pull * b
        B[i, 2] += pull * c
    return total
