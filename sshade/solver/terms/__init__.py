"""Terms of an as-rigid-as-possible energy.

Every term is a quadratic function of positions P for fixed rotations R, one rotation for each vertex. The
local step sums the covariances S of all terms and fits R to them; the global step needs the forces.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Term(Protocol):
    """A term of the energy of one solve, for one range of vertices at a time.

    Ranges are those of :func:`sshade.solver.order.vertex_ranges`; several may be worked on at once, and all
    ranges finish a method before the first one begins the next. P and B are (n, 3), R and S (n, 9) float64,
    in the solver's order of vertices.
    """

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        """Add covariances to S; return the energy ``E(P, R) + 2 tr(R S)``, which R does not change."""

    def turn(self, number: int, R: np.ndarray) -> None:
        """Prepare the forces of the new rotations; by default there is nothing to prepare."""
        return None

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        """Add minus half of the energy's gradient, over the number of corners, to B; return the energy.

        The energy counts only where strain weights are renewed; otherwise :meth:`local` gives it.
        """
