"""The bound system of an energy: everything that depends on the mesh and the handle vertices alone.

Arrays with a row for each vertex are in the solver's own order (:mod:`sshade.solver.ordered_mesh`), unless
they say otherwise.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from copy import copy
from functools import cached_property
from threading import Lock
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from sshade.core.threads import ThreadTeam
from sshade.mesh.incidence import flagged
from sshade.mesh.mesh import Mesh
from sshade.problem.options import Elements, Options
from sshade.solver.constraints import ConstrainedSurface
from sshade.solver.factorisation import Factorised, Linear, not_positive_definite
from sshade.solver.multigrid import SMOOTHER, ConjugateGradients, Multigrid, VCycle
from sshade.solver.ordered_mesh import BoundHandles, Order, OrderedMesh
from sshade.solver.terms import TERMS, Term

#: Degree of the finest level's smoother without exact steps. A polish reaches the same energy as with degree
#: 3 in 3 to 26 % less time (six bodies), because a step takes less time.
POLISH_DEGREE = 1


class System:
    """The terms of an energy, for a mesh whose handle vertices are fixed or pulled, and their matrix.

    Parameters
    ----------
    mesh : Mesh
        Rest shape; see :class:`sshade.solver.ordered_mesh.OrderedMesh`. Every component needs a handle.
    index : (k,) int
        Handle vertices, each once.
    options : Options
        Weights of the terms.
    elements : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP") or Chao et al.'s ("Elastic"), both with raw cotangents:
        ``sum_i sum_{ij} w_ij |e'_ij - R_i e_ij|^2``, and ``sum_i sum_{t at i} sum_{kl in t} h_t(kl)
        |e'_kl - R_i e_kl|^2``. The first can be negative if angles are obtuse.
    stiffness : (k,) float64, optional
        Stiffness of soft handles, see :attr:`sshade.Handles.stiffness`; inf, the default, for hard handles.
        The option `stiffness` is something else: the residual stiffness of strained triangles.
    multigrid : bool
        Use a V-cycle, which is set up in each solve, in place of a factorisation. Time and memory are linear
        in the size of the mesh, and low energies are reached sooner if triangles soften. Choose it beyond
        100,000 vertices. See :mod:`sshade.solver.factorisation`.
    with_struts : (n,) bool, optional
        Vertices that have struts, if the options have a thickness; by default all.
    exact_steps : int
        Number of nearly exact first steps with multigrid, for a start far from the minimum. The step that
        proves convergence is nearly exact as well.

    Attributes
    ----------
    ordered : OrderedMesh
    handles : BoundHandles
    terms : list of Term
        The terms that are on.
    rest_energy : float
        Energy of the whole mesh shrunk to a point; unit length^2.

    Raises
    ------
    InputError
        On unknown elements, or handle vertices that are out of range, given twice or missing in a component.
        A factorisation raises it for a Laplacian that is not positive definite to rounding.
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        options: Options | None = None,
        *,
        elements: Elements = "spokes_and_rims",
        stiffness: np.ndarray | None = None,
        with_struts: np.ndarray | None = None,
        multigrid: bool = False,
        exact_steps: int = 0,
    ) -> None:
        self.mesh = mesh
        self.ordered = OrderedMesh(mesh, elements, with_struts)
        self.multigrid = multigrid
        self.exact_steps = exact_steps
        self._options = options or Options()
        self.handles = BoundHandles.of(self.ordered, index, stiffness)
        self._take([term.bound(self.ordered, self.handles, self._options) for term in TERMS])

    def with_handles(self, index: np.ndarray, *, stiffness: np.ndarray | None = None) -> Self:
        """Bind other handles of the same mesh and energy, by a new factorisation.

        Both systems stay usable, and share all data that do not depend on handles. Parameters and errors as
        for the class and a factorisation, without multigrid.
        """
        other = copy(self)
        other.__dict__.pop("matrix", None)
        other.handles = BoundHandles.of(self.ordered, index, stiffness)
        arguments = self.ordered, other.handles, self._options
        own = {type(term): term for term in self.terms}
        other._take(
            [own[kind].with_handles(*arguments) if kind in own else kind.bound(*arguments) for kind in TERMS]
        )
        other.factorise()
        return other

    def _take(self, terms: Sequence[Term | None]) -> None:
        """Take terms, of which None are off."""
        self.terms = [term for term in terms if term is not None]
        self.rest_energy = sum(term.rest_energy for term in self.terms)
        # A cached_property of Python 3.11 would let one system wait for the factorisation of another.
        self._factorised: Factorised | None = None
        self._lock = Lock()

    @property
    def corners(self) -> int:
        """Number of corners of an element; see :class:`sshade.solver.ordered_mesh.OrderedMesh`."""
        return self.ordered.corners

    @cached_property
    def surface(self) -> ConstrainedSurface:
        """The faces in the solver's order, for constraints."""
        ordered = self.ordered
        return ConstrainedSurface(self.mesh, ordered.place, ordered.elements if self.corners == 3 else None)

    def factorise(self) -> None:
        """Factorise now instead of in the first solve. Errors as of the class."""
        self.factorised  # noqa: B018 - made here

    @cached_property
    def matrix(self) -> csr_array:
        """(n, n): the matrix at rest, in the mesh's order."""
        return assembled(self.terms, "mesh")

    @property
    def factorised(self) -> Factorised | None:
        """The factorisation of the matrix at rest, made when first asked for; None with multigrid."""
        if self.multigrid:
            return None
        with self._lock:
            if self._factorised is None:
                fixed = self.handles.index[self.handles.hard]
                self._factorised = Factorised(self.matrix, fixed, self.ordered.place)
            return self._factorised

    def linear(self, terms: Sequence[Term], *, team: ThreadTeam, softened: bool = False) -> Linear:
        """Return the linear solve of a global step, where a solve with its own `terms` begins.

        If `softened`, factorise the Laplacian with the present strain weights.
        """
        fixed = self.handles.fixed
        if softened:
            return Factorised(assembled(terms, "solver"), fixed)
        if self.factorised:
            return self.factorised
        degree = len(SMOOTHER) if self.exact_steps else POLISH_DEGREE
        try:
            # The matrix has no name here, so that its memory is freed while coarser levels are made.
            multigrid = Multigrid(
                assembled(self.terms if self.exact_steps else terms, "solver"),
                flagged(fixed, self.mesh.n),
                degree=degree,
                team=team,
            )
        except FloatingPointError as error:
            raise not_positive_definite() from error
        give_back()
        if self.exact_steps:
            return ConjugateGradients(multigrid, fixed, steps=self.exact_steps)
        return VCycle(multigrid, fixed)

    def to_system(self, positions: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n, 3) in the solver's order, relative to the mesh's origin, with hard handles on their targets."""
        u = positions[self.ordered.vertex] - self.mesh.origin
        u[self.handles.fixed] = targets[self.handles.hard] - self.mesh.origin
        return u

    def from_system(self, u: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n, 3) in the mesh's order, with hard handles exactly on their targets."""
        positions = np.take(u, self.ordered.place, axis=0) + self.mesh.origin
        hard = self.handles.hard
        positions[self.handles.index[hard]] = targets[hard]
        return positions


def assembled(terms: Sequence[Term], order: Order) -> csr_array:
    """Return the matrix (n, n) of terms: the sum of all, diagonal ones after the first, dense ones last."""
    total, *others = (term.matrix(order) for term in terms)
    total = csr_array(total)
    for diagonal in (matrix for matrix in others if matrix.ndim == 1):
        total.setdiag(total.diagonal() + diagonal)
    for matrix in reversed([matrix for matrix in others if matrix.ndim == 2]):
        total = csr_array(total + matrix)
    return total


def give_back() -> None:
    """Return the memory that the C library keeps after arrays are freed, where it is glibc.

    After arrays of some megabytes in several threads, glibc keeps about a fifth of the memory of a polish.
    The call takes milliseconds.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
