"""Pulls towards points: soft handles and attachment.

A pull of stiffness k towards q costs ``corners k f |p - q|^2``, with a fraction f in [0, 1] that may change
from solve to solve. The matrix of the global step always contains the whole stiffness k, so that its
factorisation serves all fractions. For f < 1 a step is shorter than the best one, and still descends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array

from sshade.solver.terms import Term


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
    ranges : list of (slice, int, int)
        See :func:`sshade.solver.order.vertex_ranges`.
    corners : int
        Number of times that the energy counts each edge.
    """

    def __init__(self, springs: Springs, ranges: list[tuple[slice, int, int]], *, corners: int) -> None:
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
        gap = self._targets[own] - P[self._springs.place[own]]
        return self._corners * float(np.einsum("i,ic,ic", self._stiffness[own], gap, gap))

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        own = self._of_range[number]
        place = self._springs.place[own]
        B[place] += self._stiffness[own, None] * (self._targets[own] - P[place])
        return self.local(number, P, R)
