"""The bound system of an energy: everything that depends on the mesh and the handle vertices alone.

Arrays with a row for each vertex are in the solver's own order, a band ordering, unless they say otherwise.
The elimination order of a factorisation scatters neighbours over memory. Loops over triangles run five times
faster in the band ordering, where neighbours stay in cache (at 150,000 vertices).
"""

from __future__ import annotations

import ctypes
import sys
from copy import copy
from functools import cached_property
from threading import Lock
from typing import Self, TypeGuard

import numpy as np
from scipy.sparse import csr_array, diags_array

from sshade.core.errors import InputError
from sshade.core.threads import ThreadTeam, beside
from sshade.mesh.mesh import Mesh
from sshade.mesh.sides import flagged
from sshade.problem.handle_checks import checked_index
from sshade.problem.options import Energy
from sshade.solver.constraints import ConstrainedSurface
from sshade.solver.factorisation import Factorised, Linear, not_positive_definite
from sshade.solver.laplacian import (
    band_order,
    edge_weights,
    faces_in_order,
    half_cotangents,
    laplacian_matrix,
    pattern_in_order,
    rest_energies,
    vertex_ranges,
    weighted_laplacian,
)
from sshade.solver.multigrid import SMOOTHER, ConjugateGradients, Multigrid, VCycle
from sshade.solver.terms import Springs
from sshade.solver.terms.arap import Edges, Elements, Triangles
from sshade.solver.terms.bending import Plate, bending_matrix, bending_stiffness
from sshade.solver.terms.struts import Struts

#: Least strain weight of a triangle in the metric of a V-cycle or a softened Laplacian. Weights change during
#: a solve, because strain moves. A step descends while each weight is less than twice its value in the
#: metric. Values from 0.1 to 0.5 were tried: smaller ones save little time in V-cycles, and led softened
#: Laplacians to other minima.
LEAST_WEIGHT = 0.25
#: Degree of the finest level's smoother without exact steps. A polish reaches the same energy as with degree
#: 3 in 3 to 26 % less time (six bodies), because a step takes less time.
POLISH_DEGREE = 1


class System:
    """Weights, elements and matrix of a mesh whose handle vertices are fixed or pulled.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. May have a boundary, and triangles of zero area: see
        :func:`sshade.solver.laplacian.half_cotangents`.
    index : (k,) int
        Handle vertices, each once. Every component needs one.
    energy : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP") or Chao et al.'s ("Elastic"), both with raw cotangents:
        ``sum_i sum_{ij} w_ij |e'_ij - R_i e_ij|^2``, and ``sum_i sum_{t at i} sum_{kl in t} h_t(kl)
        |e'_kl - R_i e_kl|^2``. The first can be negative if angles are obtuse.
    stiffness : (k,) float64, optional
        Stiffness of soft handles, see :attr:`sshade.Handles.stiffness`; inf, the default, for hard handles.
        The option `stiffness` of a solve is something else: the residual stiffness of strained triangles.
    multigrid : bool
        Use a V-cycle, which is set up in each solve, in place of a factorisation. Time and memory are linear
        in the size of the mesh, and low energies are reached sooner if triangles soften. Choose it beyond
        100,000 vertices. See :mod:`sshade.solver.factorisation`.
    exact_steps : int
        Number of nearly exact first steps with multigrid, for a start far from the minimum. The step that
        proves convergence is nearly exact as well.
    bending : float
        Length over which the bending energy spreads a fold, as a fraction of the square root of the mesh's
        area; 0 for none. See :mod:`sshade.solver.terms.bending`.
    thickness : float
        Weight of the local thickness; 0 for none. See :mod:`sshade.solver.terms.struts`.
    inertia : float
        Weight of the majority motion of the handles, which each solve is given; 0 for none. See
        :mod:`sshade.solver.terms.inertia`.

    Attributes
    ----------
    mesh : Mesh
    index : (k,) int64
        Handle vertices.
    vertex : (n,) int
        Vertex of the mesh at each place of the solver's order.
    place : (n,) int32
        Place of each vertex of the mesh.
    hard : (h,) int64
        Numbers of the hard handles in `index`.
    fixed : (h,) int
        Places of the hard handles.
    springs : Springs
        The soft handles and attached vertices.
    multigrid : bool
        Whether V-cycles take the place of a factorisation.
    corners : int
        Number of corners of an element: 2 for edges, 3 for triangles. All terms of the energy have this
        factor, because the as-rigid-as-possible terms count each element once for each corner.
    elements : Edges or Triangles
        In the order of their lowest vertices.
    ranges : list of (slice, int, int)
        See :func:`sshade.solver.laplacian.vertex_ranges`.
    rest : (m,) float64
        Energy of each element shrunk to a point: 6 A for a triangle, positive.
    plate : Plate or None
        The bending energy.
    struts : Struts or None
        The springs that keep the local thickness.
    inertia : (n,) float64 or None
        Stiffness of the inertia of each vertex; 0 for hard handles.
    rest_energy : float
        Energy of the whole mesh shrunk to a point; unit length^2.
    matrix : (n, n) csr_array or None
        Laplacian with stiffness of pulls and bending, in the mesh's order. None with multigrid.
    factorised : Factorised or None
        Of `matrix`; made when first asked for, which a softened solve never does. None with multigrid.

    Raises
    ------
    InputError
        On an unknown energy, or handle vertices that are out of range, given twice or missing in a component.
        A factorisation raises it for a Laplacian that is not positive definite to rounding.
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        *,
        energy: Energy = "spokes_and_rims",
        stiffness: np.ndarray | None = None,
        multigrid: bool = False,
        exact_steps: int = 0,
        bending: float = 0.0,
        thickness: float = 0.0,
        inertia: float = 0.0,
    ) -> None:
        if energy not in ("spokes", "spokes_and_rims"):
            raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
        self.mesh, self.exact_steps, self._length = mesh, exact_steps, bending * float(np.sqrt(mesh.area))
        self._inertia = inertia
        self.vertex = band_order(mesh)
        self.place = np.empty(mesh.n, dtype=np.int32)
        self.place[self.vertex] = np.arange(mesh.n, dtype=np.int32)
        self._take_handles(index, stiffness)
        h = half_cotangents(mesh)
        self.multigrid = multigrid
        needed = bending > 0 or not multigrid
        self._laplacian = laplacian_matrix(mesh.n, *edge_weights(mesh, h)) if needed else None
        self.corners = 2 if energy == "spokes" else 3
        self.struts = Struts.of(mesh, self.place, thickness, self.corners) if thickness else None
        with beside(self._bind, size=mesh.n) as bound:
            self._list_elements(h)
            bound.result()
        self.rest_energy = self._total_rest_energy()

    def with_handles(self, index: np.ndarray, *, stiffness: np.ndarray | None = None) -> Self:
        """Bind other handles of the same mesh and energy, by a new factorisation.

        Both systems stay usable, and share all data that do not depend on handles. Parameters and errors as
        for the class and a factorisation, without multigrid.
        """
        other = copy(self)
        other._take_handles(index, stiffness)
        other._bind()
        other.rest_energy = other._total_rest_energy()
        other.factorise()
        return other

    def _take_handles(self, index: np.ndarray, stiffness: np.ndarray | None) -> None:
        index = checked_index(index, once=True)
        self.mesh.require_handles(index)
        stiffness = np.full(len(index), np.inf) if stiffness is None else stiffness
        self.index, self.hard = index, np.flatnonzero(np.isinf(stiffness))
        self.fixed = self.place[index[self.hard]]
        handle = np.flatnonzero(np.isfinite(stiffness))
        handle = handle[np.argsort(self.place[index[handle]])]
        self.springs = Springs(handle, index[handle], self.place[index[handle]], stiffness[handle])
        self.inertia: np.ndarray | None = None
        if self._inertia:
            self.inertia = (self._inertia * self.mesh.vertex_areas / self.mesh.area)[self.vertex]
            self.inertia[self.fixed] = 0.0

    def _bind(self) -> None:
        """Make the bending energy; assemble the matrix, unless V-cycles take its place."""
        self.matrix, self.plate = None, None
        # A cached_property of Python 3.11 would let one system wait for the factorisation of another.
        self._factorised: Factorised | None = None
        self._lock = Lock()
        laplacian, fixed = self._laplacian, self.index[self.hard]
        if laplacian is None:
            return
        if self._length:
            stiffness = bending_stiffness(self.mesh, laplacian, fixed, self._length)
            in_order = laplacian[self.vertex][:, self.vertex]
            in_order.sort_indices()
            rest = in_order @ (self.mesh.V - self.mesh.origin)[self.vertex]
            self.plate = Plate(in_order, stiffness[self.vertex], rest, self.corners)
        if self.multigrid:
            return
        self.matrix = laplacian
        if len(self.springs.vertex):
            self.matrix = csr_array(self.matrix + self.springs.matrix(self.mesh.n))
        if self.struts:
            self.matrix = csr_array(self.matrix + self.struts.matrix(self.mesh.n))
        if self.inertia is not None:
            self.matrix = csr_array(self.matrix + diags_array(self.inertia[self.place]))
        if self._length:
            self.matrix = csr_array(self.matrix + bending_matrix(laplacian, stiffness))

    def factorise(self) -> None:
        """Factorise now instead of in the first solve. Errors as of the class."""
        self.factorised  # noqa: B018 - made here

    @property
    def factorised(self) -> Factorised | None:
        with self._lock:
            if self._factorised is None and self.matrix is not None:
                self._factorised = Factorised(self.matrix, self.index[self.hard], self.place)
            return self._factorised

    def _list_elements(self, h: np.ndarray) -> None:
        """List edges or triangles for half cotangents h (m, 3)."""
        mesh = self.mesh
        self.elements: Elements
        if self.corners == 2:
            edges, weights = edge_weights(mesh, h)
            near = np.argsort(self.place[edges].min(axis=1), kind="stable")
            edges, H = edges[near], weights[near, None]
            E = mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]
            self.elements = Edges(self.place[edges].astype(np.uint32), (H * E)[:, None], H)
            self.rest = 2.0 * H[:, 0] * (E * E).sum(axis=1)
        else:
            corners, face = faces_in_order(mesh.F, self.place)
            self.elements = Triangles(corners, mesh.V[self.vertex], h[face])
            self.rest = rest_energies(mesh, h)[face]
        self.ranges = vertex_ranges(self.elements.corners, mesh.n)

    def _total_rest_energy(self) -> float:
        return float(self.rest.sum()) + sum(term.rest_energy for term in (self.plate, self.struts) if term)

    @cached_property
    def surface(self) -> ConstrainedSurface:
        """The faces in the solver's order, for constraints."""
        return ConstrainedSurface(self.mesh, self.place, self.elements.corners if self.corners == 3 else None)

    def metric(self, weight: np.ndarray | None = None) -> csr_array:
        """Assemble the matrix of a V-cycle: Laplacian with weights (m,) of triangles, and all other terms."""
        pattern = pattern_in_order(self.mesh, self.vertex, self.place)
        L = weighted_laplacian(*pattern, self.elements.corners, self.elements.H, weight)
        if len(self.springs.place):
            diagonal = L.diagonal()
            diagonal[self.springs.place] += self.springs.stiffness
            L.setdiag(diagonal)
        if self.inertia is not None:
            L.setdiag(L.diagonal() + self.inertia)
        if self.plate:
            L = csr_array(L + bending_matrix(self.plate.laplacian, self.plate.stiffness))
        if self.struts:
            ends = np.stack([self.struts.first, self.struts.second])
            L = csr_array(L + self.struts.matrix(self.mesh.n, ends=ends))
        return L

    def softens(self, weight: np.ndarray | None) -> TypeGuard[np.ndarray]:
        """Whether there is a Laplacian with strain weights to factorise."""
        return weight is not None and not self.multigrid

    def linear(self, weight: np.ndarray | None, *, team: ThreadTeam, softened: bool = False) -> Linear:
        """Return the linear solve of a global step, for strain weights (m,) where the solve begins.

        If `softened`, factorise the Laplacian with these weights, where they can be had: see :meth:`softens`.
        """
        if softened and self.softens(weight):
            return Factorised(self.metric(np.maximum(weight, LEAST_WEIGHT)), self.fixed)
        if self.factorised:
            return self.factorised
        fixed = flagged(self.fixed, self.mesh.n)
        weighted = None if weight is None or self.exact_steps else np.maximum(weight, LEAST_WEIGHT)
        degree = len(SMOOTHER) if self.exact_steps else POLISH_DEGREE
        try:
            # The matrix has no name here, so that its memory is freed while coarser levels are made.
            multigrid = Multigrid(self.metric(weighted), fixed, degree=degree, team=team)
        except FloatingPointError as error:
            raise not_positive_definite() from error
        give_back()
        if self.exact_steps:
            return ConjugateGradients(multigrid, self.fixed, steps=self.exact_steps)
        return VCycle(multigrid, self.fixed)


def give_back() -> None:
    """Return the memory that the C library keeps after arrays are freed, where it is glibc.

    After arrays of some megabytes in several threads, glibc keeps about a fifth of the memory of a polish.
    The call takes milliseconds.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
