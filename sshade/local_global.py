"""As-rigid-as-possible deformation by a local/global solver of our own, with Anderson acceleration.

The mesh and the choice of handle vertices are bound once (:class:`LocalGlobal`:
weights, element lists, Cholesky factor), then solved for any number of handle
positions. All heavy steps run without the GIL: solvers in several threads
proceed at the same time.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sshade.anderson import Anderson, largest_move
from sshade.coarse import Energy, Start, initial_guess
from sshade.cotangents import corner_vectors, edge_weights, half_cotangents, laplacian_matrix
from sshade.errors import InputError
from sshade.linalg import Engine, factor
from sshade.mesh import Mesh
from sshade.rotations import local_step, right_hand_side
from sshade.task import DeformationResult, DeformationTask, Progress, silent

#: A rise of the energy below this (x the rest shape's Dirichlet energy) is rounding, not a bad step.
ENERGY_ROUNDING = 1e-14
#: Iterations between two calls of the progress callback.
REPORT_EVERY = 10


class Solution(NamedTuple):
    """A deformed shape and how the iteration went.

    Attributes
    ----------
    positions : (n, 3) float64
        The handles are on their targets exactly.
    rotations : (n, 3, 3) float64
        The local step at `positions`: det 1, carrying rest edges to deformed ones.
    iterations : int
        Global steps.
    residual : float
        Largest move of a vertex in the last plain iteration / bounding-box diagonal.
    energy, energy_initial : float
        After the local steps at `positions` and at the start; unit length^2.
    converged : bool
    rejected : int
        Accelerated iterates given up because the energy rose.
    """

    positions: np.ndarray
    rotations: np.ndarray
    iterations: int
    residual: float
    energy: float
    energy_initial: float
    converged: bool
    rejected: int


class LocalGlobal:
    """Minimises an as-rigid-as-possible energy under prescribed vertex positions.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. May have a boundary; no zero-area triangle.
    index : (k,) int
        Vertices with prescribed positions, each once, at least one per component.
    energy : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP"), or Chao et al.'s ("Elastic"), both
        with raw cotangents: ``sum_i sum_{ij} w_ij |e'_ij - R_i e_ij|^2``, and
        ``sum_i sum_{t at i} sum_{kl in t} h_t(kl) |e'_kl - R_i e_kl|^2``. The
        first can be negative where angles are obtuse.
    engine : {"auto", "superlu", "cholespy"}
        See :func:`sshade.linalg.factor`.

    Raises
    ------
    InputError
        On an unknown energy or engine, or vertices as above that are out of
        range, repeated, or leave a component free.
    FloatingPointError
        When triangles have no area: their cotangents are infinite.
    """

    def __init__(
        self, mesh: Mesh, index: np.ndarray, *, energy: Energy = "spokes_and_rims", engine: Engine = "auto"
    ) -> None:
        if energy not in ("spokes", "spokes_and_rims"):
            raise InputError(f"unknown energy {energy!r}; use 'spokes' or 'spokes_and_rims'")
        index = _checked(mesh, index)
        h = half_cotangents(mesh)
        edges, weights = edge_weights(mesh, h)
        laplacian = laplacian_matrix(mesh.n, edges, weights)
        held = np.zeros(mesh.n, dtype=bool)
        held[index] = True
        free = np.flatnonzero(~held)
        rows = laplacian[free]
        self.mesh, self.index, self.energy = mesh, index, energy
        self._factor = factor(rows[:, free], engine=engine)
        # The elimination order scatters neighbours over memory; a band ordering keeps the
        # element loops in cache (five times faster at 150,000 vertices).
        self._vertex = reverse_cuthill_mckee(laplacian, symmetric_mode=True)
        position = np.empty(mesh.n, dtype=np.int32)
        position[self._vertex] = np.arange(mesh.n)
        free = free[self._factor.order]
        self._to_handles = laplacian[free][:, index]
        self._free, self._held = position[free], position[index]
        if energy == "spokes":
            corners, H = edges, weights[:, None]
            Y = (weights[:, None] * (mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]))[:, None]
        else:
            corners, H, Y = mesh.F, h, corner_vectors(mesh, h)
        near = np.argsort(position[corners].min(axis=1), kind="stable")
        self._corners = np.ascontiguousarray(position[corners[near]])
        self._Y, self._H = np.ascontiguousarray(Y[near]), np.ascontiguousarray(H[near])
        # Each edge of an element is counted once per corner of the element.
        squares = ((mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]]) ** 2).sum(axis=1)
        self._rest_energy = float(corners.shape[1] * (weights @ squares))

    @property
    def engine(self) -> str:
        """Name of the library behind the factorisation."""
        return self._factor.engine

    def solve(
        self,
        targets: np.ndarray,
        *,
        start: np.ndarray | None = None,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
        accelerate: bool = True,
        window: int = 5,
        progress: Progress = silent,
    ) -> Solution:
        """Iterate local and global steps to a residual.

        The residual is the largest move of a vertex in one *plain* iteration
        over the rest shape's diagonal, also under acceleration. The safeguard
        compares energies after local steps: where an accelerated iterate has a
        higher one than the iterate before, the plain one takes its place.
        Deterministic, and safe to call from several threads at once.

        Parameters
        ----------
        targets : (k, 3) float64
            Positions of the handle vertices, in the order of `index`.
        start : (n, 3) float64, optional
            Where to begin, by default the rest shape; handles go to their targets first.
        tolerance : float
            Residual under which iteration stops. 0 never stops early.
        max_iterations : int
        accelerate : bool
            Anderson acceleration.
        window : int
            Differences it keeps.
        progress : Progress

        Returns
        -------
        Solution

        Raises
        ------
        InputError
            On a wrong shape, or a window under 1.
        FloatingPointError
            When an iterate is not finite.
        """
        targets, start = self._checked_positions(targets, start)
        if window < 1:
            raise InputError(f"the acceleration window must be at least 1, not {window}")
        n = self.mesh.n
        u = np.ascontiguousarray(start[self._vertex])
        u[self._held] = targets
        g, fixed = u.copy(), -(self._to_handles @ targets)
        X = np.empty_like(fixed)
        Q, R, B = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.empty((n, 9)), np.empty((n, 3))
        mixer = Anderson(3 * n, window) if accelerate else None
        iterations, rejected, residual, accelerated = 0, 0, np.inf, False
        energies = [np.inf]
        while True:
            energy = local_step(self._corners, self._Y, self._H, u, Q, R)
            if accelerated and energy > energies[-1] + ENERGY_ROUNDING * abs(self._rest_energy):
                u[:] = mixer.plain.reshape(-1, 3)
                energy = local_step(self._corners, self._Y, self._H, u, Q, R)
                rejected += 1
            energies.append(energy)
            if residual < tolerance or iterations >= max_iterations:
                break
            right_hand_side(self._corners, self._Y, R, B)
            _gather(B, self._free, fixed, X)
            self._factor.solve_ordered(X)
            _scatter(X, self._free, g)
            # Here g is the plain iterate g(u). A constraint on the iterates would project g
            # at this point, and u after `advance`.
            residual = float(largest_move(g, u)) / self.mesh.diagonal
            iterations += 1
            if not np.isfinite(residual):
                raise FloatingPointError(f"the positions are not finite after {iterations} iterations")
            accelerated = accelerate and residual >= tolerance and iterations < max_iterations
            if accelerated:
                mixer.advance(u.reshape(-1), g.reshape(-1))
            else:
                u[:] = g
            if iterations % REPORT_EVERY == 0:
                progress("iterations", iterations, max_iterations, f"residual {residual:.1e}")
        progress("iterations", iterations, max_iterations, f"residual {residual:.1e}")
        positions, rotations = np.empty((n, 3)), np.empty((n, 3, 3))
        positions[self._vertex] = u
        rotations[self._vertex] = R.reshape(-1, 3, 3)
        return Solution(
            positions=positions,
            rotations=rotations,
            iterations=iterations,
            residual=residual,
            energy=self._rest_energy + energies[-1],
            energy_initial=self._rest_energy + energies[1],
            converged=residual < tolerance,
            rejected=rejected,
        )

    def _checked_positions(self, targets, start) -> tuple[np.ndarray, np.ndarray]:
        k, n = len(self.index), self.mesh.n
        targets = np.asarray(targets, dtype=np.float64)
        start = self.mesh.V if start is None else np.asarray(start, dtype=np.float64)
        if targets.shape != (k, 3):
            raise InputError(f"{k} handles need targets of shape ({k}, 3), not {targets.shape}")
        if start.shape != (n, 3):
            raise InputError(f"the start must have shape ({n}, 3), not {start.shape}")
        if not (np.isfinite(targets).all() and np.isfinite(start).all()):
            raise InputError("a target or a starting position is NaN or infinite")
        return targets, start


def local_global(
    task: DeformationTask,
    *,
    energy: Energy = "spokes_and_rims",
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    accelerate: bool = True,
    start: Start = "rest",
    engine: Engine = "auto",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with our own accelerated local/global solver.

    Parameters
    ----------
    task : DeformationTask
    energy : {"spokes", "spokes_and_rims"}
    tolerance : float
        Residual of one plain iteration, relative to the diagonal, under which
        iteration stops. 0 never stops early.
    max_iterations : int
        Cutoff; the paper's is 1000.
    accelerate : bool
        Anderson acceleration (window 5), to the same minimum in a fraction of the steps.
    start : {"rest", "rigid"}
        See :func:`sshade.coarse.initial_guess`.
    engine : {"auto", "superlu", "cholespy"}
        See :func:`sshade.linalg.factor`.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds ``rotations`` (n, 3, 3), ``residual``, ``energy``,
        ``energy_initial``, ``rejected`` and ``engine``.

    Raises
    ------
    InputError
        On an unknown energy, start or engine.
    FloatingPointError
        When triangles have no area.
    """
    begin = perf_counter()
    solver = LocalGlobal(task.mesh, task.handles.index, energy=energy, engine=engine)
    precomputed = perf_counter()
    solution = solver.solve(
        task.handles.target,
        start=initial_guess(task, start),
        tolerance=tolerance,
        max_iterations=max_iterations,
        accelerate=accelerate,
        progress=progress,
    )
    extra: dict[str, Any] = {
        name: getattr(solution, name)
        for name in ("rotations", "residual", "energy", "energy_initial", "rejected")
    }
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
        extra={**extra, "engine": solver.engine},
    )


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
