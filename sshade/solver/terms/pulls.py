"""Pulls towards points: soft handles and attachment.

A pull of stiffness k towards q costs ``corners k f |p - q|^2``, with a fraction f in [0, 1] that may change
from solve to solve. The matrix of the global step always contains the whole stiffness k, so that its
factorisation serves all fractions. For f < 1 a step is shorter than the best one, and still descends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_array


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


class Pulls:
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
        self._parts = [slice(*np.searchsorted(springs.place, own[1:])) for own in ranges]

    def aim(self, targets: np.ndarray, fraction: np.ndarray | None) -> None:
        """Set targets (k, 3) and pull fractions (k,), 1 by default, of all handles."""
        handle = self._springs.handle
        self._targets = targets[handle]
        self._fraction = np.ones(len(handle)) if fraction is None else fraction[handle]

    def _part(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        own, springs = self._parts[number], self._springs
        return springs.place[own], springs.stiffness[own], self._fraction[own], self._targets[own]

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        return self._corners * _energy(*self._part(number), P)

    def turn(self, number: int, R: np.ndarray) -> None:
        pass

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        part = self._part(number)
        _add_forces(*part, P, B)
        return self._corners * _energy(*part, P)


@njit(cache=True, nogil=True)
def _energy(place, stiffness, fraction, target, P):
    """Return ``sum fraction_i stiffness_i |P_i - target_i|^2`` over the vertices at `place` (j,)."""
    total = 0.0
    for j in range(len(place)):
        i = place[j]
        x, y, z = P[i, 0] - target[j, 0], P[i, 1] - target[j, 1], P[i, 2] - target[j, 2]
        total += fraction[j] * stiffness[j] * (x * x + y * y + z * z)
    return total


@njit(cache=True, nogil=True)
def _add_forces(place, stiffness, fraction, target, P, B):
    """Add ``fraction_i stiffness_i (target_i - P_i)`` to B (n, 3) for the vertices at `place` (j,)."""
    for j in range(len(place)):
        i, k = place[j], fraction[j] * stiffness[j]
        for c in range(3):
            B[i, c] += k * (target[j, c] - P[i, c])
