"""The as-rigid-as-possible terms: edges (spokes) or triangles (spokes and rims), and their strain weights.

An element has two or three corners i at rest positions v_i and present positions p_i. It has a vector y_i for
each corner, and the vectors add up to zero:

- spokes: an edge (i, j) with y_i = w_ij (v_i - v_j);
- spokes and rims: a triangle with y_i = sum over its edges ij of h_ij (v_i - v_j).

An element adds ``sum_i y_i p_i^T`` to the covariance S of each corner. To the force on corner i it adds the
mean rotation of its corners times y_i, minus y_i computed from present positions.

Strain weights. Quadratic energies spread the strain of a bend over a large region. A triangle of rest area A
with strain weights costs

    6 A phi(s^2),   phi(x) = c x + 2 (1 - c) e^2 (sqrt(1 + x / e^2) - 1)
                             + (1 - c) x (1 - 1 / sqrt(1 + x^2 / d^4)),

where s^2 is its spokes-and-rims energy over 6 A: the squared strain of a uniform stretch. The energy is
quadratic for strains below the softening strain e. Beyond e the stiffness falls to a fraction c, and beyond
the strain limit d it rises to 1 again. The first line is a pseudo-Huber penalty with a floor; the second
line is strain limiting, as of skin. Strain therefore gathers at joints, but no single row of triangles
takes all of it, which limits how sharply a bend can crease. Folds count as strain, because the energy
favours equal rotations at the corners of a triangle.

Without a strain limit, phi is concave. The quadratic energy with each triangle weighted by ``w = phi'(s^2)``
then lies above the energy and touches it, and neither the local nor the global step raises it. The Laplacian
of the rest shape may stay in the global step, because w <= 1, and is factorised once (half-quadratic
minimisation). A strain limit well above e leaves w at most 1 + e / d, and second derivatives are at most 1.8
times those of the quadratic energy. The steps descend up to a factor of 2.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes); I. Chao, U. Pinkall, P. Sanan,
P. Schroeder, "A simple geometric model for elastic deformations", 2010 (spokes and rims: the paper's
"Elastic"); D. Geman, C. Yang, "Nonlinear image recovery with half-quadratic regularization", IEEE TIP 4(7),
1995.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array

from sshade.core.errors import InputError
from sshade.core.kernels import kernel, subroutine
from sshade.problem.options import Options
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh
from sshade.solver.terms.term import Term

#: Triangles that are worked on together; their intermediate values stay in the first-level cache.
LANES = 128
#: Stands for weights of 1.
UNWEIGHTED = np.empty(0)
#: Least strain weight of a triangle in the metric of a V-cycle or a softened Laplacian. Weights change during
#: a solve, because strain moves. A step descends while each weight is less than twice its value in the
#: metric. Values from 0.1 to 0.5 were tried: smaller ones save little time in V-cycles, and led softened
#: Laplacians to other minima.
LEAST_WEIGHT = 0.25


class Edges(NamedTuple):
    """Elements of the spokes energy.

    Attributes
    ----------
    corners : (e, 2) uint32
        Vertices of each edge. Unsigned indices save kernels a test for negative ones.
    Y : (e, 1, 3) float64
        y of the first corner; the second corner has the opposite.
    H : (e, 1) float64
        Weights.
    """

    corners: np.ndarray
    Y: np.ndarray
    H: np.ndarray

    def part(self, own: slice) -> Edges:
        """Return the edges of a slice."""
        return Edges(self.corners[own], self.Y[own], self.H[own])

    def covariances(
        self, P: np.ndarray, S: np.ndarray, first: int, end: int, weight: np.ndarray = UNWEIGHTED
    ) -> float:
        """Write the covariances of the vertices from `first` to `end` to S.

        Calls for ranges that cover all vertices write the same bits as a single call, and may run at the
        same time. The elements must include all that touch the range.

        Parameters
        ----------
        P : (n, 3) float64
            Deformed positions.
        S : (n, 9) float64
            Row by row; only the rows of the range are written.
        first, end : int
        weight : (m,) float64, optional
            Weights of triangles; edges have none.

        Returns
        -------
        float
            ``corners x sum_edges h |e'|^2`` of the elements whose lowest vertex is in the range, unweighted.
        """
        return _edge_covariances(*self, P, S, first, end)

    def forces(self, P: np.ndarray, R: np.ndarray, B: np.ndarray, first: int, end: int) -> None:
        """Write minus half of the energy's gradient, divided by the number of corners, to rows of B (n, 3).

        This is ``b(R) - L P``, with the right-hand side b of the usual global step ``L p = b(R)``. Parameters
        as of :meth:`covariances`; R (n, 9) are the rotation matrices.
        """
        _edge_forces(*self, P, R, B, first, end)


class Triangles(NamedTuple):
    """Elements of the spokes-and-rims energy. Kernels compute y from rest positions, which saves memory.

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
        """Return the triangles of a slice."""
        return Triangles(self.corners[own], self.V, self.H[own])

    def covariances(
        self, P: np.ndarray, S: np.ndarray, first: int, end: int, weight: np.ndarray = UNWEIGHTED
    ) -> float:
        """Write covariances; see :meth:`Edges.covariances`."""
        return _triangle_covariances(*self, weight, P, S, first, end)

    def forces(self, P: np.ndarray, R: np.ndarray, B: np.ndarray, first: int, end: int) -> None:
        """Write forces; see :meth:`Edges.forces`."""
        _triangle_forces(*self, P, R, B, first, end)


class Arap(Term):
    """The edges or triangles of the energy; see :class:`sshade.solver.terms.term.Term`.

    The options `stiffness`, `strain` and `strain_limit` are c, e and d above.

    Attributes
    ----------
    weight : (m,) float64 or None
        Strain weights of the triangles at the last local step of a solve; None for the quadratic energy.

    Raises
    ------
    InputError
        When edges should soften.
    """

    option = "stiffness"
    rigid = True
    _softening: tuple[float, float, float]

    def __init__(self, ordered: OrderedMesh) -> None:
        self._ordered = ordered
        self._elements: Edges | Triangles
        if ordered.corners == 2:
            E = ordered.V[ordered.elements[:, 0]] - ordered.V[ordered.elements[:, 1]]
            self._elements = Edges(ordered.elements, (ordered.H * E)[:, None], ordered.H)
        else:
            self._elements = Triangles(ordered.elements, ordered.V, ordered.H)
        self.rest_energy = float(ordered.rest.sum())
        self.weight: np.ndarray | None = None

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self:
        return cls(ordered)

    def with_handles(self, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self:
        return self

    def matrix(self, order: Order) -> csr_array:
        """Return the Laplacian; during a solve in the solver's order, with the present strain weights."""
        if order == "mesh":
            return self._ordered.laplacian.copy()
        weight = None if self.weight is None else np.maximum(self.weight, LEAST_WEIGHT)
        return self._ordered.weighted_laplacian(weight)

    def begun(self, options: Options) -> Self:
        term = copy(self)
        term._softening = options.stiffness, options.strain**-2, options.strain_limit**-2
        if options.stiffness < 1.0:
            if not isinstance(self._elements, Triangles):
                raise InputError("only triangles soften: use the energy spokes_and_rims, or a stiffness of 1")
            term.weight = np.ones(len(self._ordered.rest))
        return term

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        own, first, end = self._ordered.ranges[number]
        weight = UNWEIGHTED if self.weight is None else self.weight[own]
        return self._elements.part(own).covariances(P, S, first, end, weight)

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        """Write forces to B and renew the strain weights, in one pass over the triangles."""
        own, first, end = self._ordered.ranges[number]
        part = self._elements.part(own)
        if self.weight is None:
            part.forces(P, R, B, first, end)
            return 0.0
        rest, weight = self._ordered.rest[own], self.weight[own]
        return _weighted_forces(*part, rest, P, R, *self._softening, weight, B, first, end)


@subroutine(fastmath={"contract"})
def _first_two(V, i, j, k, r, h0, h1, h2):
    """Coordinate r of y at the corners i and j of a triangle (i, j, k)."""
    side = h0 * (V[i, r] - V[j, r])
    return side + h2 * (V[i, r] - V[k, r]), h1 * (V[j, r] - V[k, r]) - side


@kernel(fastmath={"contract"})
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
            y, z = _first_two(V, i, j, k, r, h0, h1, h2)
            x0, x1, x2 = y * ax + z * bx, y * ay + z * by, y * az + z * bz
            for c in (i, j, k):
                if first <= c < end:
                    S[c, 3 * r] += x0
                    S[c, 3 * r + 1] += x1
                    S[c, 3 * r + 2] += x2
    return energy


@kernel(fastmath={"contract"})
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


@kernel(fastmath={"contract"})
def _triangle_forces(corners, V, H, P, R, B, first, end):
    B[first:end] = 0.0
    third = 1.0 / 3.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        h0, h1, h2 = H[t, 0], H[t, 1], H[t, 2]
        yx, zx = _first_two(V, i, j, k, 0, h0, h1, h2)
        yy, zy = _first_two(V, i, j, k, 1, h0, h1, h2)
        yz, zz = _first_two(V, i, j, k, 2, h0, h1, h2)
        for r in range(3):
            a = third * (R[i, 3 * r] + R[j, 3 * r] + R[k, 3 * r])
            b = third * (R[i, 3 * r + 1] + R[j, 3 * r + 1] + R[k, 3 * r + 1])
            c = third * (R[i, 3 * r + 2] + R[j, 3 * r + 2] + R[k, 3 * r + 2])
            ij, jk, ki = P[i, r] - P[j, r], P[j, r] - P[k, r], P[k, r] - P[i, r]
            at_i = a * yx + b * yy + c * yz - (h0 * ij - h2 * ki)
            at_j = a * zx + b * zy + c * zz - (h1 * jk - h0 * ij)
            for corner, force in ((i, at_i), (j, at_j), (k, -at_i - at_j)):
                if first <= corner < end:
                    B[corner, r] += force


@kernel(fastmath={"contract"})
def _edge_forces(corners, Y, H, P, R, B, first, end):
    B[first:end] = 0.0
    for t in range(len(corners)):
        i, j = corners[t, 0], corners[t, 1]
        for r in range(3):
            a = 0.5 * (R[i, 3 * r] + R[j, 3 * r])
            b = 0.5 * (R[i, 3 * r + 1] + R[j, 3 * r + 1])
            c = 0.5 * (R[i, 3 * r + 2] + R[j, 3 * r + 2])
            at_i = a * Y[t, 0, 0] + b * Y[t, 0, 1] + c * Y[t, 0, 2] - H[t, 0] * (P[i, r] - P[j, r])
            if first <= i < end:
                B[i, r] += at_i
            if first <= j < end:
                B[j, r] -= at_i


@kernel(fastmath={"contract"})
def _weighted_forces(corners, V, H, rest, P, R, stiffness, soft, stiff, weight, B, first, end):
    """Write phi'(s^2) of each triangle to `weight`, and rows of B; return the energy ``sum rest phi(s^2)``.

    `soft` and `stiff` are 1 / e^2 and 1 / d^2. One pass for both takes two thirds of the time of two passes.
    """
    B[first:end] = 0.0
    energy, x, ratio, pull = 0.0, np.empty(LANES), np.empty(LANES), np.empty((LANES, 6))
    for begin in range(0, len(corners), LANES):
        own = slice(begin, min(begin + LANES, len(corners)))
        near, w = corners[own], weight[own]
        _strain(near, V, H[own], rest[own], P, R, x, pull)
        _soften(stiffness, soft, stiff, x[: len(near)], w, ratio)
        for t in range(len(near)):
            i, j, k = near[t, 0], near[t, 1], near[t, 2]
            if min(i, j, k) >= first:
                energy += rest[begin + t] * x[t] * ratio[t]
            for c in range(3):
                at_i, at_j = w[t] * pull[t, c], w[t] * pull[t, 3 + c]
                for corner, force in ((i, at_i), (j, at_j), (k, -at_i - at_j)):
                    if first <= corner < end:
                        B[corner, c] += force
    return energy


# Without numpy's error model, the test for a division by zero is a branch in the loop.
@subroutine(error_model="numpy", fastmath={"contract"})
def _soften(stiffness, soft, stiff, x, weight, ratio):
    """Write phi'(x) to `weight`, and phi(x) / x to `ratio`."""
    for t in range(len(x)):
        root, y = np.sqrt(1.0 + soft * x[t]), stiff * x[t]
        again = 1.0 / np.sqrt(1.0 + y * y)
        weight[t] = stiffness + (1.0 - stiffness) * (1.0 / root + 1.0 - again * again * again)
        # root - 1 and 1 - again without cancellation, for strains far below e and d.
        both = 2.0 / (1.0 + root) + y * y * again * again / (1.0 + again)
        ratio[t] = stiffness + (1.0 - stiffness) * both


@subroutine(error_model="numpy", fastmath={"contract"})
def _strain(corners, V, H, rest, P, R, x, pull):
    """Write s^2 of triangles to x, and the unweighted forces on their first two corners to `pull`."""
    third = 1.0 / 3.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        h0, h1, h2 = H[t, 0], H[t, 1], H[t, 2]
        yx, zx = _first_two(V, i, j, k, 0, h0, h1, h2)
        yy, zy = _first_two(V, i, j, k, 1, h0, h1, h2)
        yz, zz = _first_two(V, i, j, k, 2, h0, h1, h2)
        bends = 0.0
        strains = 0.0
        for r in range(3):
            a, b, c = (
                R[i, 3 * r] + R[j, 3 * r] + R[k, 3 * r],
                R[i, 3 * r + 1] + R[j, 3 * r + 1] + R[k, 3 * r + 1],
                R[i, 3 * r + 2] + R[j, 3 * r + 2] + R[k, 3 * r + 2],
            )
            at_i, at_j = a * yx + b * yy + c * yz, a * zx + b * zy + c * zz
            ij, jk, ki = P[i, r] - P[j, r], P[j, r] - P[k, r], P[k, r] - P[i, r]
            bends += at_j * jk - at_i * ki
            strains += h0 * ij * ij + h1 * jk * jk + h2 * ki * ki
            of_i, of_j = h0 * ij - h2 * ki, h1 * jk - h0 * ij
            pull[t, r], pull[t, 3 + r] = third * at_i - of_i, third * at_j - of_j
        x[t] = max(rest[t] + 3.0 * strains - 2.0 * bends, 0.0) / rest[t]
