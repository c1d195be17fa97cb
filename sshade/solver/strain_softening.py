"""Strain softening: strain gathers at joints, and limbs keep their shape.

Quadratic energies spread the strain of a bend over all that can take a share
of it. Here a triangle of rest area A costs

    6 A phi(s^2),   phi(x) = c x + 2 (1 - c) e^2 (sqrt(1 + x / e^2) - 1)
                             + (1 - c) x (1 - 1 / sqrt(1 + x^2 / d^4)),

where s^2 is its spokes-and-rims energy over 6 A: the squared strain, if it is
stretched alike in all directions. Under the strain e that is the quadratic
energy; beyond it the stiffness falls to the residual stiffness c, and beyond the limit d it is
back at 1. The first line is a pseudo-Huber penalty with a floor, the second strain
limiting, as of skin: strain gathers at joints, and yet no row of triangles takes all of it, which
bounds how sharply a bend can crease. Folds are strain here, as the energy asks
for like rotations at the corners of a triangle.

Without a limit the function is concave in s^2, so the quadratic energy with each triangle
weighted by ``w = phi'(s^2)`` lies above it and touches it. As w <= 1, the one
without weights does so too once the part (1 - w) pulls towards the present
positions: the Laplacian stays that of the rest shape, factorised once
(half-quadratic minimisation; D. Geman, C. Yang, "Nonlinear image recovery with
half-quadratic regularization", IEEE TIP 4(7), 1995). Neither step raises the energy. With one,
and e well under d, w is up to 1 + e / d, and second derivatives up to 1.8 times those of the
quadratic energy: under the 2 up to which its steps descend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.errors import InputError
from sshade.solver.terms import Terms, Triangles, covariances

#: Triangles that are worked on together: what is kept of them stays in the first-level cache.
LANES = 128


@dataclass(frozen=True)
class StrainSoftening:
    """How triangles soften.

    Parameters
    ----------
    stiffness : float
        c, the residual stiffness of strongly strained triangles over that of unstrained
        ones, in (0, 1]. 1 is the quadratic energy.
    strain : float
        e, the strain about which it falls; positive, without unit.
    strain_limit : float
        d, the strain about which it rises again; positive, inf for never.

    Raises
    ------
    InputError
        On other values.
    """

    stiffness: float = 1.0
    strain: float = 0.02
    strain_limit: float = np.inf

    def __post_init__(self) -> None:
        if not 0 < self.stiffness <= 1:
            raise InputError(f"the stiffness goes from above 0 to 1 (no softening), not {self.stiffness}")
        if not 0 < self.strain < np.inf:
            raise InputError(f"the strain at which triangles soften must be positive, not {self.strain}")
        if not self.strain_limit > 0:
            raise InputError(
                f"the strain at which triangles are stiff again must be positive, not {self.strain_limit}"
            )

    def of(self, terms: Terms | Triangles, rest: np.ndarray) -> SoftenedTriangles | None:
        """The softening of a solve; None where the energy is quadratic.

        Parameters
        ----------
        terms : Terms or Triangles
        rest : (m,) float64
            6 A of each triangle.

        Raises
        ------
        InputError
            Where the terms are edges.
        """
        if self.stiffness == 1.0:
            return None
        if not isinstance(terms, Triangles):
            raise InputError("only triangles soften: take the energy spokes_and_rims, or a stiffness of 1")
        return SoftenedTriangles(self, terms, rest)


class SoftenedTriangles:
    """The triangles of one solve; a :class:`sshade.solver.interfaces.Softening`.

    Attributes
    ----------
    weight : (m,) float64
        w of each triangle at the last local step.
    """

    def __init__(self, softening: StrainSoftening, terms: Triangles, rest: np.ndarray) -> None:
        self._softening, self._terms, self._rest = softening, terms, rest
        self.weight = np.ones(len(rest))

    def covariances(self, own: slice, P: np.ndarray, S: np.ndarray, first: int, end: int) -> float:
        covariances(self._terms.part(own), P, S, first, end, weight=self.weight[own])
        return 0.0

    def energy_and_forces(
        self, own: slice, first: int, end: int, P: np.ndarray, R: np.ndarray, B: np.ndarray, *, kept: float
    ) -> float:
        asked = self._softening
        how = asked.stiffness, asked.strain**-2, asked.strain_limit**-2, kept
        triangles = *self._terms.part(own), self._rest[own]
        return _weigh(*triangles, P, R, *how, self.weight[own], B, first, end)


@njit(cache=True, nogil=True)
def _weigh(corners, V, H, rest, P, R, stiffness, soft, stiff, kept, weight, B, first, end):
    """Write phi'(s^2) of each triangle to `weight`, and rows of B; return the energy ``sum rest phi(s^2)``.

    `soft` and `stiff` are 1 / e^2 and 1 / d^2.
    """
    B[first:end] = 0.0
    energy, share = 0.0, np.empty(LANES)
    x, pull, stay = np.empty(LANES), np.empty((LANES, 6)), np.empty((LANES, 6))
    for begin in range(0, len(corners), LANES):
        own = slice(begin, min(begin + LANES, len(corners)))
        near, w = corners[own], weight[own]
        _strain(near, V, H[own], rest[own], P, R, kept, x, pull, stay)
        _soften(stiffness, soft, stiff, x[: len(near)], w, share)
        for t in range(len(near)):
            i, j, k = near[t, 0], near[t, 1], near[t, 2]
            if min(i, j, k) >= first:
                energy += rest[begin + t] * x[t] * share[t]
            for c in range(3):
                at_i, at_j = w[t] * pull[t, c] + stay[t, c], w[t] * pull[t, 3 + c] + stay[t, 3 + c]
                if first <= i < end:
                    B[i, c] += at_i
                if first <= j < end:
                    B[j, c] += at_j
                if first <= k < end:
                    B[k, c] -= at_i + at_j
    return energy


# Where a division by zero is an error, a loop has a branch.
@njit(cache=True, nogil=True, error_model="numpy")
def _soften(stiffness, soft, stiff, x, weight, share):
    """Write phi'(x) and phi(x) / x."""
    for t in range(len(x)):
        root, y = np.sqrt(1.0 + soft * x[t]), stiff * x[t]
        again = 1.0 / np.sqrt(1.0 + y * y)
        weight[t] = stiffness + (1.0 - stiffness) * (1.0 / root + 1.0 - again * again * again)
        # root - 1 and 1 - again without cancellation, for strains far below e and d.
        both = 2.0 / (1.0 + root) + y * y * again * again / (1.0 + again)
        share[t] = stiffness + (1.0 - stiffness) * both


@njit(cache=True, nogil=True, error_model="numpy")
def _strain(corners, V, H, rest, P, R, kept, x, pull, stay):
    """Write s^2 of triangles, and for B, of their first two corners, weight times `pull` and `stay`."""
    third = 1.0 / 3.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        h0, h1, h2 = H[t, 0], H[t, 1], H[t, 2]
        # The edges 01, 12, 20 at rest, and y of the first two corners.
        ux, uy, uz = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
        vx, vy, vz = V[j, 0] - V[k, 0], V[j, 1] - V[k, 1], V[j, 2] - V[k, 2]
        wx, wy, wz = V[k, 0] - V[i, 0], V[k, 1] - V[i, 1], V[k, 2] - V[i, 2]
        ux, uy, uz = h0 * ux, h0 * uy, h0 * uz
        yx, yy, yz = ux - h2 * wx, uy - h2 * wy, uz - h2 * wz
        zx, zy, zz = h1 * vx - ux, h1 * vy - uy, h1 * vz - uz
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
            stay[t, r], stay[t, 3 + r] = kept * of_i, kept * of_j
        x[t] = max(rest[t] + 3.0 * strains - 2.0 * bends, 0.0) / rest[t]
