"""The as-rigid-as-possible system of a mesh with handles, and its plain iteration.

The local step fits a rotation R_i to the covariance ``S_i = sum w_ij e_ij e'_ij^T`` of
each vertex; the global step solves ``L q = b(R)`` with the Laplacian of the rest shape
and the handle vertices eliminated: see :mod:`sshade.solver.global_step`. A soft handle of stiffness k
stays in the system, with k on its diagonal entry of L and k times its target in b. Both energies are
sums of terms: see :mod:`sshade.solver.terms`; with bending, there is another term for each vertex, see
:mod:`sshade.solver.bending`. Constraints and softening are given to an iteration as
objects, see :mod:`sshade.solver.interfaces`; the system knows of neither.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from copy import copy

import numpy as np
from scipy.sparse import coo_array, csr_array

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.options import Energy
from sshade.solver.assembly import (
    band_order,
    dirichlet_energy,
    faces_in_order,
    pattern_in_order,
    vertex_ranges,
    weighted_laplacian,
)
from sshade.solver.bending import Bending, bending_matrix, shares
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix, rest_energies
from sshade.solver.global_step import FactorisedLaplacian, FactorisedStep, GlobalStep, MultigridStep
from sshade.solver.interfaces import Constraints, Softening
from sshade.solver.rotations import fit_rotations, quaternions
from sshade.solver.terms import Terms, Triangles, add_pulls, covariances, pulling_energy, right_hand_side
from sshade.threads import ThreadTeam


class ArapSystem:
    """Weights, terms and Laplacian of a mesh whose handle vertices are held or pulled.

    Parameters and errors as of :class:`sshade.solver.local_global.LocalGlobal`. All
    arrays of vertices are in an order of its own, a band ordering: the
    elimination order scatters neighbours over memory, and the loops over terms run
    five times faster where they stay in cache (at 150,000 vertices).

    Attributes
    ----------
    mesh : Mesh
    index : (k,) int64
    vertex : (n,) int
        Vertex of the mesh at each place of the order.
    place : (n,) int32
        Place of each vertex of the mesh.
    hard, soft : (h,), (s,) int64
        Which of the `index` are held, and which pulled.
    held, pulled : (h,), (s,) int
        Places of these.
    pull : (s,) float64
        Stiffness of those that are pulled.
    laplacian : csr_array or None
        (n, n), held vertices included, with the pull of soft handles and with bending, in this order. None
        where the global step goes by multigrid: see :meth:`metric`.
    bending : Bending or None
        None there, too.
    factorised : FactorisedLaplacian or None
        None there, too.
    exact_steps : int
        See :class:`sshade.solver.global_step.MultigridStep`.
    terms : Terms or Triangles
        In the order of their lowest vertices.
    rest : (e,) float64
        6 A of each triangle, the energy of one shrunk to a point; positive; of edges nothing.
    rest_energy : float
        That of the whole mesh; unit length^2.
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        *,
        energy: Energy,
        stiffness: np.ndarray | None = None,
        multigrid: bool = False,
        exact_steps: int = 0,
        bending: float = 0.0,
    ) -> None:
        if energy not in ("spokes", "spokes_and_rims"):
            raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
        if bending and multigrid:
            raise InputError("bending needs a factorisation, not multigrid")
        self.mesh, self.exact_steps, self._length = mesh, exact_steps, bending * float(np.sqrt(mesh.area))
        self._take_handles(index, stiffness)
        self._order_vertices()
        self._place_handles()
        h = half_cotangents(mesh)
        self.laplacian: csr_array | None = None
        self.factorised: FactorisedLaplacian | None = None
        self.bending: Bending | None = None
        if multigrid:
            self._list_terms(h, energy=energy)
        else:
            plain = laplacian_matrix(mesh.n, *edge_weights(mesh, h))
            self._diagonal, share = plain.diagonal(), self._bending_shares(plain)
            laplacian = self._with_bending(self._with_pull(plain), plain, share)
            with ThreadPoolExecutor(max_workers=1) as pool:
                # Meanwhile, as it takes the longest.
                factorised = pool.submit(FactorisedLaplacian, laplacian, self._held_index)
                self._keep(laplacian)
                self._list_terms(h, energy=energy)
                self._list_bending(plain, share)
                self.factorised = factorised.result()

    def with_handles(self, index: np.ndarray, *, stiffness: np.ndarray | None = None) -> ArapSystem:
        """The factorised system of the same mesh with other handles; what these do not change is shared."""
        if self.laplacian is None:
            raise InputError("a system without a factorisation takes no other handles: bind it anew")
        other, L = copy(self), self.bending.laplacian if self.bending else self.laplacian
        plain = L[self.place][:, self.place]
        plain.sort_indices()
        plain.setdiag(self._diagonal)
        other._take_handles(index, stiffness)
        other._place_handles()
        share = other._bending_shares(plain)
        laplacian = other._with_bending(other._with_pull(plain), plain, share)
        other._keep(laplacian)
        other._list_bending(plain, share)
        other.factorised = FactorisedLaplacian(laplacian, other._held_index)
        return other

    def _take_handles(self, index: np.ndarray, stiffness: np.ndarray | None) -> None:
        self.index = _checked(self.mesh, index)
        stiffness = _checked_stiffness(stiffness, len(self.index))
        self.hard, self.soft = np.flatnonzero(np.isinf(stiffness)), np.flatnonzero(np.isfinite(stiffness))
        self.pull, self._held_index = stiffness[self.soft], self.index[self.hard]

    def _order_vertices(self) -> None:
        mesh = self.mesh
        self.vertex = band_order(mesh)
        self.place = np.empty(mesh.n, dtype=np.int32)
        self.place[self.vertex] = np.arange(mesh.n, dtype=np.int32)

    def _place_handles(self) -> None:
        self.held, self.pulled = self.place[self._held_index], self.place[self.index[self.soft]]

    def _with_pull(self, laplacian: csr_array) -> csr_array:
        """A Laplacian in the order of the mesh's vertices with the pull of soft handles."""
        if not len(self.soft):
            return laplacian
        soft = self.index[self.soft]
        return csr_array(laplacian + coo_array((self.pull, (soft, soft)), shape=laplacian.shape))

    def _bending_shares(self, plain: csr_array) -> np.ndarray | None:
        return shares(self.mesh, plain, self._held_index, self._length) if self._length else None

    def _with_bending(self, laplacian: csr_array, plain: csr_array, share: np.ndarray | None) -> csr_array:
        return laplacian if share is None else csr_array(laplacian + bending_matrix(plain, share))

    def _keep(self, laplacian: csr_array) -> None:
        self.laplacian = self._in_order(laplacian)

    def _in_order(self, laplacian: csr_array) -> csr_array:
        laplacian = laplacian[self.vertex][:, self.vertex]
        laplacian.sort_indices()
        return laplacian

    def _list_terms(self, h: np.ndarray, *, energy: Energy) -> None:
        mesh = self.mesh
        V = mesh.V[self.vertex]
        self.terms: Terms | Triangles
        if energy == "spokes":
            self.terms, self.rest = self._edges(h), np.empty(0)
        else:
            corners, face = faces_in_order(mesh.F, self.place)
            self.terms, self.rest = Triangles(corners, V, h[face]), rest_energies(mesh, h)[face]
        corners = self.terms.corners
        self.rest_energy = self._stretch = corners.shape[1] * float(
            dirichlet_energy(corners, V, self.terms.H)
        )
        self.ranges = vertex_ranges(corners, mesh.n)

    def _list_bending(self, plain: csr_array, share: np.ndarray | None) -> None:
        if share is None:
            return
        V = (self.mesh.V - self.mesh.origin)[self.vertex]
        weight = float(self.terms.corners.shape[1])
        self.bending = Bending.of(self._in_order(plain), share[self.vertex], V, weight)
        self.rest_energy = self._stretch + self.bending.rest_energy

    def _edges(self, h: np.ndarray) -> Terms:
        edges, weights = edge_weights(self.mesh, h)
        near = np.argsort(self.place[edges].min(axis=1), kind="stable")
        edges, H = edges[near], weights[near, None]
        Y = H * (self.mesh.V[edges[:, 0]] - self.mesh.V[edges[:, 1]])
        return Terms(self.place[edges].astype(np.uint32), Y[:, None], H)

    def metric(self, weight: np.ndarray | None = None) -> csr_array:
        """The Laplacian of triangles with weights (m,), or of all terms; and the pull of soft handles."""
        pattern = pattern_in_order(self.mesh, self.vertex, self.place)
        L = weighted_laplacian(*pattern, self.terms.corners, self.terms.H, weight)
        if len(self.pulled):
            pulls = L.diagonal()
            pulls[self.pulled] += self.pull
            L.setdiag(pulls)
        return L


class ArapIteration:
    """One plain iteration under fixed targets: a local step, a global step, and the constraints.

    Holds the work arrays of one solve.

    Parameters
    ----------
    system : ArapSystem
    targets : (k, 3) float64
        Positions of the handle vertices, in the order of the system's `index`.
    team : ThreadTeam
    constraints : Constraints, optional
    softening : Softening, optional
    prescribed : ((j,) int, (j, 3, 3) float64), optional
        Vertices of the mesh, each once, whose rotations are given and not fitted, and these.
    fraction : (k,) float64, optional
        Of the stiffness of soft handles, in [0, 1]; by default 1. As the Laplacian has all of it, the rest
        pulls to the present positions, as softening does: see :mod:`sshade.solver.strain_softening`.

    Attributes
    ----------
    R : (n, 9) float64
        Rotation matrices of the last local step, row by row.
    restored : bool
        The last :meth:`restore` succeeded.
    """

    def __init__(
        self,
        system: ArapSystem,
        targets: np.ndarray,
        *,
        team: ThreadTeam,
        constraints: Constraints | None = None,
        softening: Softening | None = None,
        prescribed: tuple[np.ndarray, np.ndarray] | None = None,
        fraction: np.ndarray | None = None,
    ) -> None:
        n = system.mesh.n
        self.system, self._team = system, team
        self._constraints, self._softening, self.restored = constraints, softening, True
        self._step: GlobalStep
        if system.factorised is None:
            self._step = MultigridStep(system, softening, team=team)
        else:
            self._step = FactorisedStep(system, system.factorised, team=team)
        order = np.argsort(system.pulled)
        self._soft, self._pulled, self._pull = system.soft[order], system.pulled[order], system.pull[order]
        self._aim(targets, prescribed, fraction)
        self._Q, self.R, self._B = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.empty((n, 9)), np.empty((n, 3))
        self._W = np.empty((n if system.bending else 0, 3))

    def aim(
        self,
        targets: np.ndarray,
        volume_goal: float,
        *,
        prescribed: tuple[np.ndarray, np.ndarray] | None = None,
        fraction: np.ndarray | None = None,
    ) -> None:
        """Take other targets, known rotations, shares, and another goal for volumes, over those at rest."""
        if self._constraints:
            self._constraints.retry(volume_goal)
        self._aim(targets, prescribed, fraction)

    def _aim(
        self,
        targets: np.ndarray,
        prescribed: tuple[np.ndarray, np.ndarray] | None,
        fraction: np.ndarray | None,
    ) -> None:
        system = self.system
        self._step.aim(targets[system.hard])
        self._towards = targets[self._soft]
        self._share = np.ones(len(self._soft)) if fraction is None else fraction[self._soft]
        vertex, rotations = prescribed or (np.empty(0, dtype=np.int64), np.empty((0, 3, 3)))
        order = np.argsort(system.place[vertex])
        self._known = system.place[vertex][order], np.array(rotations, dtype=np.float64)[order]

    def begin_with(self, rotations: np.ndarray) -> None:
        """Begin the search for rotations at those (n, 3, 3) of the mesh's vertices."""
        n = self.system.mesh.n
        rotations = np.ascontiguousarray(rotations, dtype=np.float64)
        if rotations.shape != (n, 3, 3):
            raise InputError(f"the rotations must have shape ({n}, 3, 3), not {rotations.shape}")
        Q, error = quaternions(rotations)
        if not error < 1e-6:
            raise InputError("a matrix in the rotations to begin with is not a rotation")
        self._Q[:] = Q[self.system.vertex]

    def local_step(self, u: np.ndarray) -> float:
        """Fit the rotations to positions u (n, 3); return the energy there less the rest energy.

        With softening, what triangles add to the right-hand side of a global step from u is made along.
        """
        s, softening = self.system, self._softening

        def fit(number: int) -> float:
            own, first, end = s.ranges[number]
            if softening is None:
                energy = covariances(s.terms.part(own), u, self.R, first, end)
            else:
                energy = softening.covariances(own, u, self.R, first, end)
            if s.bending:
                energy += s.bending.add_covariances(u, self.R, first, end)
            pulls[number] = s.terms.corners.shape[1] * pulling_energy(*self._pulls(first, end), u)
            return energy - 2.0 * self._fit(first, end)

        pulls = np.zeros(len(s.ranges))
        energy = sum(self._team(fit, len(s.ranges)))
        if softening is not None:

            def soften(number: int) -> float:
                return softening.energy_and_forces(*s.ranges[number], u, self.R, self._B, kept=kept)

            kept = self._step.kept
            energy = sum(self._team(soften, len(s.ranges))) - s.rest_energy
            if bending := s.bending:
                energy += sum(self._team.ranges(lambda *own: bending.energy(u, self.R, *own), len(u)))
        energy += float(pulls.sum())
        return energy + self._constraints.penalty(u) if self._constraints else energy

    def _pulls(self, first: int, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places (j,) of the soft handles in a range, stiffness (j,), share of it (j,), targets (j, 3)."""
        own = slice(*np.searchsorted(self._pulled, (first, end)))
        return self._pulled[own], self._pull[own], self._share[own], self._towards[own]

    def _fit(self, first: int, end: int) -> float:
        """Replace covariances S of a range in R by rotations, fitted or known; return ``sum tr(R S)``."""
        place, rotations = self._known
        own = slice(*np.searchsorted(place, (first, end)))
        known, given = place[own], rotations[own]
        S = self.R[known].reshape(-1, 3, 3)
        total = fit_rotations(self.R[first:end], self._Q[first:end])
        if len(known):
            fitted = self.R[known].reshape(-1, 3, 3)
            total += float(np.einsum("iab,iba->", given - fitted, S))
            self.R[known] = given.reshape(-1, 9)
        return total

    def global_step(self, u: np.ndarray, g: np.ndarray) -> None:
        """Write to g (n, 3) the best positions for the rotations of a local step at u (n, 3), near u."""
        s, constraints = self.system, self._constraints
        if bending := s.bending:
            self._team.ranges(lambda *own: bending.turn(self.R, self._W, *own), len(u))
        self._team(lambda number: self._right_hand_side(u, number), len(s.ranges))
        self._step.solve(u, self._B, g)
        if constraints:
            if constraints.renews_directions:
                self._step.renew_directions(constraints, u)
            constraints.project(g)

    @property
    def rough(self) -> bool:
        """Whether the next :meth:`global_step` is too rough to say how near the minimum is."""
        return self._step.rough

    def refine(self) -> None:
        """Let the next :meth:`global_step` not be rough."""
        self._step.refine()

    def restore(self, u: np.ndarray) -> None:
        """Project positions u (n, 3) onto the exact constraints, along the present directions."""
        if self._constraints:
            self.restored = self._constraints.restore(u)

    def project(self, u: np.ndarray) -> None:
        """Project positions u (n, 3) onto the exact constraints, along directions of their own."""
        if self._constraints:
            self._step.renew_directions(self._constraints, u)
            self.restore(u)

    def gradient(self, F: np.ndarray) -> np.ndarray:
        """(n, 3) the metric times F (n, 3), the move of the last :meth:`global_step`; valid till the next.

        That is the energy's gradient there, but for its sign and what the constraints take of it.
        """
        self._step.gradient(self._constraints, F, self._B)
        return self._B

    def _right_hand_side(self, u: np.ndarray, number: int) -> None:
        """Write the rows of one range, without what held vertices add, to B."""
        own, first, end = self.system.ranges[number]
        kept = self._step.kept
        if self._softening is None:
            right_hand_side(self.system.terms.part(own), self.R, self._B, first, end, P=u, kept=kept)
        if self.system.bending:
            self.system.bending.add_product(self._W, self._B, first, end)
        place, pull, share, towards = self._pulls(first, end)
        add_pulls(place, pull, share, towards, kept, u, self._B)
        if self._constraints:
            self._constraints.add_forces(number, u, self._B)


def _checked(mesh: Mesh, index: np.ndarray) -> np.ndarray:
    index = np.array(index, dtype=np.int64)
    if index.ndim != 1 or len(index) == 0:
        raise InputError("at least one vertex needs a prescribed position")
    mesh.require_handles(index)
    if np.bincount(index).max() > 1:
        raise InputError("a handle vertex is given twice")
    return index


def _checked_stiffness(stiffness: np.ndarray | None, k: int) -> np.ndarray:
    stiffness = np.full(k, np.inf) if stiffness is None else np.asarray(stiffness, dtype=np.float64)
    if stiffness.shape != (k,) or not (stiffness > 0).all():
        raise InputError(f"{k} handles need as many stiffnesses above 0, not {stiffness.shape}")
    return stiffness
