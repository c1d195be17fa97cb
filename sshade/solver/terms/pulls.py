"""Pulls: soft handles and attached vertices are pulled to their targets.

A pulled vertex costs ``stiffness |p_i - target_i|^2``, beside the as-rigid-as-possible energy that counts
each edge once.
"""

from __future__ import annotations

from typing import Self

import numpy as np

from sshade.core.kernels import kernel
from sshade.problem.options import Options
from sshade.solver.aim import Aim
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh
from sshade.solver.terms.term import Term


class Pulls(Term):
    """The pulls of the soft handles; see :class:`sshade.solver.terms.term.Term`."""

    option = "attachment"
    rigid = False

    def __init__(self, ordered: OrderedMesh, handles: BoundHandles) -> None:
        self._ordered = ordered
        self._handles = handles
        self._own = [slice(*np.searchsorted(handles.pulled, own[1:])) for own in ordered.ranges]

    @classmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        return cls(ordered, handles) if len(handles.soft) else None

    def matrix(self, order: Order) -> np.ndarray:
        diagonal = np.zeros(self._ordered.mesh.n)
        diagonal[self._handles.pulled] = self._handles.stiffness
        return self._ordered.in_order(diagonal, order)

    def aim(self, aim: Aim) -> None:
        soft = self._handles.soft
        self._targets = (aim.targets - self._ordered.mesh.origin)[soft]
        self._stiffness = self._handles.stiffness
        if aim.fraction is not None:
            self._stiffness = aim.fraction[soft] * self._stiffness

    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        own = self._own[number]
        place, stiffness, target = self._handles.pulled[own], self._stiffness[own], self._targets[own]
        return self._ordered.corners * _energy(place, stiffness, target, P)

    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        own = self._own[number]
        _add_forces(self._handles.pulled[own], self._stiffness[own], self._targets[own], P, B)
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
