"""Terms of an as-rigid-as-possible energy.

Every term is a quadratic function of positions P for fixed rotations R, one rotation for each vertex. The
local step sums the covariances S of all terms and fits R to them; the global step needs the forces.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import coo_array

from sshade.core.kernels import kernel
from sshade.solver.laplacian import Ranges


class Term(Protocol):
    """A term of the energy of one solve, for one range of vertices at a time.

    The parameter `number` is the position of a range in :func:`sshade.solver.laplacian.vertex_ranges`.
    Threads work on several ranges at once. All ranges finish a method before the next method begins. P and B
    are (n, 3), R and S (n, 9) float64, in the solver's order of vertices. The first term of an energy
    overwrites S and B, and further terms add to them.
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


class Springs(NamedTuple):
    """Pulled vertices of a bound problem.

    Attributes
    ----------
    handle : (s,) int64
        Numbers of the pulled vertices among the handles.
    vertex : (s,) int64
        The vertices of the mesh.
    place : (s,) int
        Their places in the solver's order, ascending.
    stiffness : (s,) float64
    """

    handle: np.ndarray
    vertex: np.ndarray
    place: np.ndarray
    stiffness: np.ndarray

    def matrix(self, n: int) -> coo_array:
        """Return the diagonal matrix (n, n) of the stiffness, in the mesh's order of vertices."""
        return coo_array((self.stiffness, (self.vertex, self.vertex)), shape=(n, n))


class Pulls(Term):
    """The pulls of one solve; a :class:`sshade.solver.terms.Term`.

    Parameters
    ----------
    springs : Springs
    ranges : Ranges
        See :func:`sshade.solver.laplacian.vertex_ranges`.
    corners : int
        Number of times that the energy counts each edge.
    """

    def __init__(self, springs: Springs, ranges: Ranges, *, corners: int) -> None:
        self._springs, self._corners = springs, corners
        self._of_range = [slice(*np.searchsorted(springs.place, own[1:])) for own in ranges]

    def aim(self, targets: np.ndarray, fraction: np.ndarray | None) -> None:
        """Set targets (k, 3) and pull fractions (k,), 1 by default, of all handles."""
        handle = self._springs.handle
        self._targets, self._stiffness = targets[handle], self._springs.stiffness
        if fraction is not None:
            self._stiffness = fraction[handle] * self._stiffness

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        own = self._of_range[number]
        return self._corners * _energy(self._springs.place[own], self._stiffness[own], self._targets[own], P)

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        own = self._of_range[number]
        _add_forces(self._springs.place[own], self._stiffness[own], self._targets[own], P, B)
        return self.local(number, P, R)


@kernel
def _energy(place, stiffness, target, P):
    """Return ``sum stiffness_j |P_i - target_j|^2`` with i = place_j."""
    total = 0.0
    for j in range(len(place)):
        i = place[j]
        x, y, z = P[i, 0] - target[j, 0], P[i, 1] - target[j, 1], P[i, 2] - target[j, 2]
        total += stiffness[j] * (x * x + y * y + z * z)
    return total


@kernel
def _add_forces(place, stiffness, target, P, B):
    """Add ``stiffness_j (target_j - P_i)`` to B_i with i = place_j."""
    for j in range(len(place)):
        for c in range(3):
            B[place[j], c] += stiffness[j] * (target[j, c] - P[place[j], c])
