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
from sshade.solver.terms import Terms, Triangles, covariances, right_hand_side


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
    limit : float
        d, the strain about which it rises again; positive, inf for never.

    Raises
    ------
    InputError
        On other values.
    """

    stiffness: float = 1.0
    strain: float = 0.02
    limit: float = np.inf

    def __post_init__(self) -> None:
        if not 0 < self.stiffness <= 1:
            raise InputError(f"the stiffness goes from above 0 to 1 (no softening), not {self.stiffness}")
        if not 0 < self.strain < np.inf:
            raise InputError(f"the strain at which triangles soften must be positive, not {self.strain}")
        if not self.limit > 0:
            raise InputError(
                f"the strain at which triangles are stiff again must be positive, not {self.limit}"
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

    def energy(self, own: slice, P: np.ndarray, R: np.ndarray) -> float:
        asked = self._softening
        how = asked.stiffness, asked.strain**-2, asked.limit**-2
        return _weigh(*self._terms.part(own), self._rest[own], P, R, *how, self.weight[own])

    def right_hand_side(
        self, own: slice, P: np.ndarray, R: np.ndarray, B: np.ndarray, first: int, end: int, *, kept: float
    ) -> None:
        triangles, weight = self._terms.part(own), self.weight[own]
        right_hand_side(triangles, R, B, first, end, P=P, kept=kept, weight=weight)


@njit(cache=True, nogil=True)
def _weigh(corners, V, H, rest, P, R, stiffness, soft, stiff, weight):
    """Write phi'(s^2) of each triangle to `weight`; return the energy of all, ``sum rest phi(s^2)``.

    `soft` and `stiff` are 1 / e^2 and 1 / d^2.
    """
    energy = 0.0
    for t in range(len(corners)):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        ax, ay, az = P[i, 0] - P[k, 0], P[i, 1] - P[k, 1], P[i, 2] - P[k, 2]
        bx, by, bz = P[j, 0] - P[k, 0], P[j, 1] - P[k, 1], P[j, 2] - P[k, 2]
        cx, cy, cz = ax - bx, ay - by, az - bz
        quadratic = rest[t] + 3.0 * (
            H[t, 0] * (cx * cx + cy * cy + cz * cz)
            + H[t, 1] * (bx * bx + by * by + bz * bz)
            + H[t, 2] * (ax * ax + ay * ay + az * az)
        )
        for r in range(3):
            side = H[t, 0] * (V[i, r] - V[j, r])
            y, z = side + H[t, 2] * (V[i, r] - V[k, r]), H[t, 1] * (V[j, r] - V[k, r]) - side
            quadratic -= 2.0 * (
                (R[i, r] + R[j, r] + R[k, r]) * (y * ax + z * bx)
                + (R[i, 3 + r] + R[j, 3 + r] + R[k, 3 + r]) * (y * ay + z * by)
                + (R[i, 6 + r] + R[j, 6 + r] + R[k, 6 + r]) * (y * az + z * bz)
            )
        x = max(quadratic, 0.0) / rest[t]
        root, y = np.sqrt(1.0 + soft * x), stiff * x
        again = 1.0 / np.sqrt(1.0 + y * y)
        weight[t] = stiffness + (1.0 - stiffness) * (1.0 / root + 1.0 - again**3)
        # root - 1 and 1 - again without cancellation, for strains far below e and d.
        share = 2.0 / (1.0 + root) + y * y * again * again / (1.0 + again)
        energy += rest[t] * x * (stiffness + (1.0 - stiffness) * share)
    return energy
