"""The contract of a term of the energy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import ClassVar, Self

import numpy as np
from scipy.sparse import csr_array

from sshade.problem.options import Options
from sshade.solver.aim import Aim
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh


class Term(ABC):
    """A term of the energy E(P, R): quadratic, or below a quadratic function, in positions P for fixed R.

    R has one rotation for each vertex, which all terms share. The local step sums the covariances S of all
    terms and fits R to them; the global step needs the forces and the matrix. A term is bound to a mesh and
    its handles, and :meth:`begun` anew for each solve.

    Arrays P, S, R and B are in the solver's order of vertices: P and B are (n, 3), S and R (n, 9) float64,
    row by row. Positions are relative to the mesh's origin. Threads work on several ranges of vertices at
    once; the parameter `number` is the position of a range in ``ordered.ranges``, which has the elements that
    touch the range, its first vertex and its end. A method writes only rows of S and B in its range. All
    ranges finish a method before the next method begins. The first term of an energy overwrites S and B, and
    further terms add.

    Beside the sum of the elements' energies, every term has the factor ``ordered.corners``, by which B and M
    are divided.

    To add a term, write a file beside this one, add its class to :data:`sshade.solver.terms.TERMS`, and
    its weight to :mod:`sshade.problem.options` (a field of `Options` and `OptionValues`, a name in `MATRIX`)
    and to ``conf/options/method.yaml``. tests/sshade/solver/test_terms.py tests every term, and needs the
    definition of its energy.

    Attributes
    ----------
    option : str
        The option that turns the term on.
    rigid : bool
        Whether a rigid motion of P, with R turned along, leaves the energy as it is.
    rest_energy : float
        The constant of E: the part of ``E + 2 tr(R S)`` that does not depend on P; unit length^2.
    """

    option: ClassVar[str]
    rigid: ClassVar[bool]
    rest_energy: float = 0.0

    @classmethod
    @abstractmethod
    def bound(cls, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        """Return the term of a mesh and its handle vertices; None if it is off."""

    def with_handles(self, ordered: OrderedMesh, handles: BoundHandles, options: Options) -> Self | None:
        """Return the term for other handles of the same mesh: itself if handles do not change it."""
        return self.bound(ordered, handles, options)

    @abstractmethod
    def matrix(self, order: Order) -> csr_array | np.ndarray:
        """Return M (n, n), or its diagonal (n,), with the vertices in an order.

        For fixed R, ``E(P + D) <= E(P) + corners (2 tr(D^T M D) - 2 tr(D^T B))`` with the forces B at P: a
        global step with M then descends. Of a quadratic energy, M usually is the matrix itself.
        """

    def begun(self, options: Options) -> Self:
        """Return the term with work arrays of its own, for one solve."""
        return copy(self)

    def aim(self, aim: Aim) -> None:
        """Take the targets and motions of a solve."""
        return None

    @abstractmethod
    def local(self, number: int, P: np.ndarray, S: np.ndarray) -> float:
        """Add covariances to S; return ``E(P, R) + 2 tr(R S)`` without the rest energy.

        The returned value does not depend on R.
        """

    def turn(self, number: int, R: np.ndarray) -> None:
        """Prepare the forces of new rotations."""
        return None

    @abstractmethod
    def forces(self, number: int, P: np.ndarray, R: np.ndarray, B: np.ndarray) -> float:
        """Add minus half of the gradient of E, divided by the number of corners, to B; return E.

        The sum of the returned energies counts only with strain weights, which this method renews; without
        them, the first term may return 0.
        """
