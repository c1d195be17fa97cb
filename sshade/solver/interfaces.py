"""What an iteration is given besides its system: what it holds, and what softens.

:mod:`sshade.solver.constraints` and :mod:`sshade.solver.strain_softening` make them; the system and the
steps of :mod:`sshade.solver.arap` and :mod:`sshade.solver.global_step` know no more of either than this.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Constraints(Protocol):
    """Quantities of the shape that an iteration holds, such as volumes.

    P and B are (n, 3) float64, in the system's order of vertices.
    """

    #: Number of directions.
    count: int

    def retry(self, volume_goal: float) -> None:
        """Hold exactly again what could not be held, as targets have moved, and volumes at another goal."""

    @property
    def renews_directions(self) -> bool:
        """Whether the next global step is to renew the directions."""

    def penalty(self, P: np.ndarray) -> float:
        """Energy of what is held with a finite weight."""

    def add_forces(self, number: int, P: np.ndarray, B: np.ndarray) -> None:
        """Add ``sum_q lambda_q grad C_q(P)`` to a right-hand side B, of one range of vertices.

        Ranges are those of :func:`sshade.solver.assembly.vertex_ranges`; several may be worked on at once.
        """

    def gradients(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``grad C_q(P)`` and the directions of `project`, (count, n, 3) each, which the caller replaces.

        Gradients may be set to 0 where directions are.
        """

    def take_directions(self) -> None:
        """Take ``L^-1 grad C_q``, now in the second array of :meth:`gradients`."""

    def add_moves(self, G: np.ndarray) -> None:
        """Add to G (n, 3) the gradients that the last `project` moved along, as often as it did."""

    def project(self, P: np.ndarray) -> None:
        """Move P along the directions to where the constraints hold; the multipliers follow."""

    def restore(self, P: np.ndarray) -> bool:
        """Move P to where the exact constraints hold; False where they are missed by more than then."""


class Softening(Protocol):
    """An energy of each triangle in place of the quadratic one, majorised by weighted quadratics."""

    #: Weight of each triangle at the last local step, (m,) float64 above 0, little above 1 at most.
    weight: np.ndarray

    def covariances(self, own: slice, P: np.ndarray, S: np.ndarray, first: int, end: int) -> float:
        """As :func:`covariances` of the triangles `own`, each with its weight; returns 0."""

    def energy_and_forces(
        self, own: slice, first: int, end: int, P: np.ndarray, R: np.ndarray, B: np.ndarray, *, kept: float
    ) -> float:
        """Renew the weights of the triangles `own`, and write rows `first` to `end` of B (n, 3) with them.

        As of :func:`sshade.solver.terms.right_hand_side`, with ``(kept - w) L_t P`` of each triangle. Returns
        the energy of the triangles whose lowest vertex is in the range.
        """
