"""Terms of an as-rigid-as-possible energy.

Every term is a quadratic function of positions P for fixed rotations R, one rotation for each vertex. The
local step sums the covariances S of all terms and fits R to them; the global step needs the forces.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Term(Protocol):
    """A term of the energy of one solve, for one range of vertices at a time.

    The parameter `number` is the position of a range in :func:`sshade.solver.order.vertex_ranges`. Threads
    work on several ranges at once. All ranges finish a method before the next method begins. P and B are
    (n, 3), R and S (n, 9) float64, in the solver's order of vertices. The first term of an energy overwrites
    S and B, and further terms add to them.
    """

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        """Add covariances to S; return ``E(P, R) + 2 tr(R S)``, which R does not change.

        E is the energy of the term without a constant, its rest energy.
        """

    def turn(self, number: int, R: np.ndarray) -> None:
        """Prepare the forces of the new rotations; by default there is nothing to prepare."""
        return None

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        """Add minus half of the energy's gradient, divided by the number of corners, to B; return the energy.

        The returned energy is used only with strain weights, which this method renews. Without them
        :meth:`local` has returned the energy.
        """
