"""An as-rigid-as-possible energy on a mesh whose handle vertices are held: its local and its global step.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.constraints import Constraints, Hold, Wanted
from sshade.solver.cotangents import corner_vectors, edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.factorisation import Factorisation
from sshade.solver.options import Energy
from sshade.solver.quaternions import quaternions
from sshade.solver.rotations import local_step, right_hand_side
from sshade.solver.softening import Softening, soften, softened_right_hand_side, weighted_local_step
from sshade.threads import ThreadTeam

#: Vertices that a thread fits at a time.
RANGE = 32_768


class Elements:
    """Element lists, weights and the factorised Laplacian of a mesh with vertices held.

    Parameters and errors as of :class:`sshade.solver.local_global.LocalGlobal`. All
    arrays of vertices are in an order of its own, a band ordering: the
    elimination order scatters neighbours over memory, and the element loops run
    five times faster where they stay in cache (at 150,000 vertices).

    Attributes
    ----------
    vertex : (n,) int
        Vertex of the mesh at each place of the order.
    held : (k,) int
        Places of the handle vertices, in the order of `index`.
    corners : int
        How often an edge counts in the energy.
    rest_energy : float
        Of the rest shape shrunk to a point; unit length^2.
    constraints : Constraints
    """

    def __init__(self, mesh: Mesh, index: np.ndarray, *, energy: Energy) -> None:
        if energy not in ("spokes", "spokes_and_rims"):
            raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
        index = _checked(mesh, index)
        h = half_cotangents(mesh)
        edges, weights = edge_weights(mesh, h)
        laplacian = laplacian_matrix(mesh.n, edges, weights)
        held = np.zeros(mesh.n, dtype=bool)
        held[index] = True
        free = np.flatnonzero(~held)
        self.mesh, self.index = mesh, index
        with ThreadPoolExecutor(max_workers=1) as pool:
            factorised = pool.submit(Factorisation, laplacian[free][:, free])
            self.vertex = reverse_cuthill_mckee(laplacian, symmetric_mode=True)
            position = np.empty(mesh.n, dtype=np.int32)
            position[self.vertex] = np.arange(mesh.n)
            banded = laplacian[self.vertex][:, self.vertex]
            banded.sort_indices()
            self._laplacian = banded.indptr, banded.indices, banded.data
            self._list(position, h, edges=edges, weights=weights, energy=energy)
            self.constraints = Constraints(mesh, position)
            self.factor = factorised.result()
        free = free[self.factor.order]
        self._to_handles = laplacian[free][:, index]
        self._free, self.held = position[free], position[index]

    def _list(
        self, position: np.ndarray, h: np.ndarray, *, edges: np.ndarray, weights: np.ndarray, energy: Energy
    ) -> None:
        """The element lists in the order of `position` (n,), for half cotangents h (m, 3)."""
        mesh = self.mesh
        if energy == "spokes":
            corners, H = edges, weights[:, None]
            Y = (weights[:, None] * (mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]))[:, None]
        else:
            corners, H, Y = mesh.F, h, corner_vectors(mesh, h)
        near = np.argsort(position[corners].min(axis=1), kind="stable")
        self._corners = np.ascontiguousarray(position[corners[near]])
        self._Y, self._H = np.ascontiguousarray(Y[near]), np.ascontiguousarray(H[near])
        self._ranges = _ranges(self._corners, mesh.n)
        self._chunks = [slice(first, first + 2 * RANGE) for first in range(0, len(corners), 2 * RANGE)]
        # Of each triangle shrunk to a point.
        self._rest = 6.0 * mesh.face_areas[near] if energy == "spokes_and_rims" else np.empty(0)
        self.corners = corners.shape[1]
        squares = ((mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]) ** 2).sum(axis=1)
        self.rest_energy = float(self.corners * (weights @ squares))

    def iteration(
        self, targets: np.ndarray, wanted: Wanted, softening: Softening, *, team: ThreadTeam
    ) -> Iteration:
        """What maps positions to the next ones, for handles at `targets` (k, 3) float64."""
        hold = self.constraints.hold(wanted, corners=self.corners)
        if softening.stiffness == 1.0:
            return Iteration(self, targets, hold, team=team)
        if self.corners == 2:
            raise InputError("only triangles soften: take the energy spokes_and_rims, or a stiffness of 1")
        return SoftenedIteration(self, targets, hold, team=team, softening=softening)


class Iteration:
    """One plain iteration under fixed targets: a local step, a global step, and the constraints.

    Holds the work arrays of one solve; made by :meth:`Elements.iteration`.

    Attributes
    ----------
    R : (n, 9) float64
        Rotation matrices of the last local step, row by row.
    restored : bool
        The last :meth:`restore` succeeded.
    rest_energy, diagonal : float
        Of the mesh; unit length^2 and length.
    """

    def __init__(
        self, elements: Elements, targets: np.ndarray, hold: Hold | None, *, team: ThreadTeam
    ) -> None:
        n = elements.mesh.n
        self._team = team
        self.rest_energy, self.diagonal = elements.rest_energy, elements.mesh.diagonal
        self._elements, self._hold, self.restored = elements, hold, True
        self._fixed = -(elements._to_handles @ targets)
        free = len(self._fixed)
        self._X, self._wide = np.empty((free, 3)), np.zeros((free, 3 + (hold.columns if hold else 0)))
        self._Q, self.R, self._B = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.empty((n, 9)), np.empty((n, 3))
        self._push = np.empty((n if hold else 0, 3))

    def begin_with(self, rotations: np.ndarray) -> None:
        """Begin the search for rotations at those (n, 3, 3) of the mesh's vertices."""
        n = self._elements.mesh.n
        rotations = np.ascontiguousarray(rotations, dtype=np.float64)
        if rotations.shape != (n, 3, 3):
            raise InputError(f"the rotations must have shape ({n}, 3, 3), not {rotations.shape}")
        Q, error = quaternions(rotations)
        if not error < 1e-6:
            raise InputError("a matrix in the rotations to begin with is not a rotation")
        self._Q[:] = Q[self._elements.vertex]

    def local_step(self, u: np.ndarray) -> float:
        """Fit the rotations to positions u (n, 3); return the energy there, but for the rest energy."""
        energy = self._fit(u)
        return energy + self._hold.penalty(u) if self._hold else energy

    def global_step(self, u: np.ndarray, g: np.ndarray) -> None:
        """Write to g (n, 3) the best positions for the rotations, near u (n, 3) as for the constraints."""
        e, hold = self._elements, self._hold
        if hold is None:
            self._team(lambda number: self._right_hand_side(u, number), len(e._ranges))
            self._solve(self._X, g)
            return

        def piece(number: int) -> None:
            if number == 0:  # the longest first
                hold.push(u, self._push)
            else:
                self._right_hand_side(u, number - 1)

        self._team(piece, 1 + len(e._ranges))
        self._B += self._push
        if hold.turns:
            hold.gather(u, e._free, self._wide)
            self._solve(self._wide, g)
            hold.turn(self._wide, e._free)
        else:
            self._solve(self._X, g)
        hold.pull(g)

    def restore(self, u: np.ndarray) -> None:
        """Lead positions u (n, 3) back to the exact constraints, along the present directions."""
        if self._hold:
            self.restored = self._hold.restore(u)

    def correct(self, u: np.ndarray) -> None:
        """Lead positions u (n, 3) to the exact constraints, along directions of their own."""
        if self._hold:
            e = self._elements
            self._hold.gather(u, e._free, self._wide)
            e.factor.solve_ordered(self._wide, team=self._team)
            self._hold.turn(self._wide, e._free)
            self.restore(u)

    def laplacian(self, F: np.ndarray, out: np.ndarray) -> None:
        """Write the Laplacian of the rest shape times F (n, 3) to `out` (n, 3)."""
        e = self._elements

        def piece(number: int) -> None:
            _, first, end = e._ranges[number]
            _multiply(*e._laplacian, F, out, first, end)

        self._team(piece, len(e._ranges))

    def _solve(self, X: np.ndarray, g: np.ndarray) -> None:
        e = self._elements
        count = len(X)

        def gather(number: int) -> None:
            own = slice(number * RANGE, min(count, (number + 1) * RANGE))
            _gather(self._B, e._free[own], self._fixed[own], X[own])

        self._team(gather, -(-count // RANGE))
        e.factor.solve_ordered(X, team=self._team)

        def scatter(number: int) -> None:
            own = slice(number * RANGE, min(count, (number + 1) * RANGE))
            _scatter(X[own], e._free[own], g)

        self._team(scatter, -(-count // RANGE))

    def _fit(self, u: np.ndarray) -> float:
        e = self._elements

        def piece(number: int) -> float:
            own, first, end = e._ranges[number]
            return local_step(e._corners[own], e._Y[own], e._H[own], u, self._Q, self.R, first, end)

        return sum(self._team(piece, len(e._ranges)))

    def _right_hand_side(self, u: np.ndarray, number: int) -> None:
        """Write the rows of one range, without what constraints and held vertices add, to B."""
        e = self._elements
        own, first, end = e._ranges[number]
        right_hand_side(e._corners[own], e._Y[own], self.R, self._B, first, end)


class SoftenedIteration(Iteration):
    """An :class:`Iteration` whose triangles soften; see :mod:`sshade.solver.softening`.

    Attributes
    ----------
    weight : (m,) float64
        w of each triangle at the last local step, in the order of the elements.
    """

    def __init__(
        self,
        elements: Elements,
        targets: np.ndarray,
        hold: Hold | None,
        *,
        team: ThreadTeam,
        softening: Softening,
    ) -> None:
        super().__init__(elements, targets, hold, team=team)
        self.weight = np.ones(len(elements._corners))
        self._softening = softening

    def _fit(self, u: np.ndarray) -> float:
        e, (stiffness, strain), weight = self._elements, self._softening, self.weight

        def rotate(number: int) -> None:
            own, first, end = e._ranges[number]
            weighted_local_step(e._corners[own], e._Y[own], weight[own], u, self._Q, self.R, first, end)

        def weigh(number: int) -> float:
            own = e._chunks[number]
            lists = e._corners[own], e._Y[own], e._H[own], e._rest[own]
            return soften(*lists, u, self.R, stiffness, strain, weight[own])

        self._team(rotate, len(e._ranges))
        return sum(self._team(weigh, len(e._chunks))) - self.rest_energy

    def _right_hand_side(self, u: np.ndarray, number: int) -> None:
        e = self._elements
        own, first, end = e._ranges[number]
        lists = e._corners[own], e._Y[own], e._H[own], self.weight[own]
        softened_right_hand_side(*lists, u, self.R, self._B, first, end)


def _checked(mesh: Mesh, index: np.ndarray) -> np.ndarray:
    index = np.array(index, dtype=np.int64)
    if index.ndim != 1 or len(index) == 0:
        raise InputError("at least one vertex needs a prescribed position")
    if index.min() < 0 or index.max() >= mesh.n:
        raise InputError(f"a handle id is out of range: the mesh has {mesh.n} vertices")
    if len(np.unique(index)) < len(index):
        raise InputError("a handle vertex is given twice")
    free = np.setdiff1d(mesh.component, mesh.component[index])
    if len(free):
        raise InputError(f"{len(free)} components of the mesh have no handle; every component needs one")
    return index


def _ranges(corners: np.ndarray, n: int) -> list[tuple[slice, int, int]]:
    """Ranges of vertices for threads, which depend on n alone, and the elements that touch each.

    Elements are in the order of their lowest vertices.
    """
    low, high = corners.min(axis=1), np.maximum.accumulate(corners.max(axis=1))
    bounds = [*range(0, n, RANGE), n]
    return [
        (slice(int(np.searchsorted(high, first)), int(np.searchsorted(low, end))), first, end)
        for first, end in zip(bounds, bounds[1:], strict=False)
    ]


@njit(cache=True, nogil=True)
def _multiply(start, column, value, F, out, first, end):
    """Write the rows from `first` to `end` of a sparse matrix times F (n, 3) to `out`."""
    for i in range(first, end):
        x = y = z = 0.0
        for k in range(start[i], start[i + 1]):
            j, v = column[k], value[k]
            x += v * F[j, 0]
            y += v * F[j, 1]
            z += v * F[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@njit(cache=True, nogil=True)
def _gather(B, rows, fixed, X):
    for i in range(len(rows)):
        for c in range(3):
            X[i, c] = B[rows[i], c] + fixed[i, c]


@njit(cache=True, nogil=True)
def _scatter(X, rows, g):
    for i in range(len(rows)):
        for c in range(3):
            g[rows[i], c] = X[i, c]
