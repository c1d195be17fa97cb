"""As-rigid-as-possible deformation by a local/global solver of our own, with quasi-Newton steps.

The mesh and the choice of handle vertices are bound once (:class:`LocalGlobal`:
weights, element lists, Cholesky factor), then solved for any number of handle
positions. All heavy steps run without the GIL: solvers in several threads
proceed at the same time.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from math import inf
from time import perf_counter

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.coarse import Energy, Start, initial_guess
from sshade.solver.constraints import Wanted
from sshade.solver.elements import Elements
from sshade.solver.factor import Engine
from sshade.solver.iterate import iterate
from sshade.solver.quasi_newton import QuasiNewton
from sshade.solver.softening import Softening
from sshade.solver.solution import Solution
from sshade.task import DeformationResult, DeformationTask, Progress, silent
from sshade.threads import Crew


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
        See :func:`sshade.solver.factor.factor`.

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
        self._elements = Elements(mesh, index, energy=energy, engine=engine)
        self.mesh, self.index, self.energy = mesh, self._elements.index, energy

    @property
    def engine(self) -> str:
        """Name of the library behind the factorisation."""
        return self._elements.factor.engine

    def solve(
        self,
        targets: np.ndarray,
        *,
        start: np.ndarray | None = None,
        rotations: np.ndarray | None = None,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
        accelerate: bool = True,
        window: int = 5,
        volume: float = 0.0,
        area: float = 0.0,
        volume_ratio: float = 1.0,
        area_ratio: float = 1.0,
        stiffness: float = 1.0,
        strain: float = 0.02,
        max_seconds: float = inf,
        workers: int = 1,
        progress: Progress = silent,
    ) -> Solution:
        """Iterate local and global steps to a residual.

        The residual is the largest move of a vertex in one *plain* iteration
        over the rest shape's diagonal, also under acceleration. The safeguard
        compares energies after local steps: where an accelerated iterate has a
        higher one than the iterate before, or cannot be led back to the exact
        constraints, half of its step is tried, and then the plain one takes its
        place. Deterministic, and safe to call from several threads at once.

        Parameters
        ----------
        targets : (k, 3) float64
            Positions of the handle vertices, in the order of `index`.
        start : (n, 3) float64, optional
            Where to begin, by default the rest shape; handles go to their targets first.
        rotations : (n, 3, 3) float64, optional
            Those of an earlier solution near `start`: from there the first local
            step is as quick as the others, and it ends in the same rotations.
        tolerance : float
            Residual under which iteration stops. 0 never stops early.
        max_iterations : int
        accelerate : bool
            Quasi-Newton steps, L-BFGS; see :mod:`sshade.solver.quasi_newton`.
        window : int
            Steps that they remember.
        volume, area : float
            Weights of the constraints on the volume that each component encloses
            and on its area, without unit: 0 leaves it free, inf holds it exactly;
            see :class:`sshade.solver.constraints.Wanted`. Components with a boundary
            keep a free volume, with a warning.
        volume_ratio, area_ratio : float
            What to hold them at, over the rest shape's.
        stiffness, strain : float
            How triangles soften, of spokes and rims only; see :mod:`sshade.solver.softening`.
            A stiffness of 1 is the energy as published.
        max_seconds : float
            Another cutoff: no iteration begins later. The result then depends on the machine.
        workers : int
            Threads that share each iteration, from some 20,000 vertices on; no
            influence on the result.
        progress : Progress

        Returns
        -------
        Solution

        Raises
        ------
        InputError
            On a wrong shape, a window or workers under 1, a negative weight, a ratio that is not positive,
            a stiffness out of (0, 1], one under 1 with spokes, or matrices that are no rotations.
        FloatingPointError
            When an iterate is not finite.
        """
        targets, start = self._checked_positions(targets, start)
        if window < 1:
            raise InputError(f"the acceleration window must be at least 1, not {window}")
        wanted = Wanted(volume, area, volume_ratio, area_ratio).checked()
        softening = Softening(stiffness, strain).checked()
        u = start[self._elements.vertex] - self.mesh.origin
        u[self._elements.held] = targets - self.mesh.origin
        with Crew(workers) as crew:
            iteration = self._elements.iteration(u[self._elements.held], wanted, softening, crew=crew)
            if rotations is not None:
                iteration.begin_with(rotations)
            mixer = QuasiNewton(len(u), window, iteration.laplacian) if accelerate else None
            facts = iterate(
                iteration,
                u,
                mixer=mixer,
                tolerance=tolerance,
                max_iterations=max_iterations,
                deadline=perf_counter() + max_seconds,
                progress=progress,
            )
        solution = self._solution(u, iteration.R, wanted, facts)
        solution.positions[self.index] = targets
        return solution

    def constrained(
        self, positions: np.ndarray, *, volume: float = 0.0, area: float = 0.0, workers: int = 1
    ) -> np.ndarray:
        """Lead positions back to the constraints held exactly, by what costs the energy least.

        Parameters
        ----------
        positions : (n, 3) float64
            Near a shape that fulfils them. Handles stay.
        volume, area : float
            Weights; only inf matters.
        workers : int
            Threads; no influence on the result.

        Returns
        -------
        (n, 3) float64

        Raises
        ------
        InputError
            As :meth:`solve`.
        """
        targets, positions = self._checked_positions(np.asarray(positions)[self.index], positions)
        u = positions[self._elements.vertex] - self.mesh.origin
        with Crew(workers) as crew:
            iteration = self._elements.iteration(
                targets, Wanted(volume, area).checked(), Softening(), crew=crew
            )
            iteration.correct(u)
        result = np.empty_like(positions)
        result[self._elements.vertex] = u + self.mesh.origin
        result[self.index] = targets
        return result

    def _solution(self, u: np.ndarray, R: np.ndarray, wanted: Wanted, facts: dict) -> Solution:
        elements, n = self._elements, self.mesh.n
        positions, rotations = np.empty((n, 3)), np.empty((n, 3, 3))
        positions[elements.vertex] = u + self.mesh.origin
        rotations[elements.vertex] = R.reshape(-1, 3, 3)
        errors = elements.constraints.errors(u, wanted)
        volume_constraint, area_constraint = elements.constraints.status(wanted, errors)
        return Solution(
            positions=positions,
            rotations=rotations,
            volume_error=errors.volume,
            area_error=errors.area,
            volume_constraint=volume_constraint,
            area_constraint=area_constraint,
            **facts,
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
    volume: float = 0.0,
    area: float = 0.0,
    stiffness: float = 1.0,
    strain: float = 0.02,
    start: Start = "rest",
    engine: Engine = "auto",
    workers: int = 1,
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
        Quasi-Newton steps (L-BFGS, window 5), to the same minimum in a fraction of the steps.
    volume, area : float
        Weights of the constraints, 0 (free) to inf (exact); see :class:`sshade.solver.constraints.Wanted`.
    stiffness, strain : float
        How triangles soften; see :mod:`sshade.solver.softening`. A stiffness of 1 does not.
    start : {"rest", "rigid"}
        See :func:`sshade.solver.coarse.initial_guess`.
    engine : {"auto", "superlu", "cholespy"}
        See :func:`sshade.solver.factor.factor`.
    workers : int
        Threads that share each iteration; no influence on the result.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds the ``engine`` and, as of :class:`Solution`,
        ``rotations``, ``residual``, the energies, ``rejected``, and the errors
        and states of volume and area.

    Raises
    ------
    InputError
        On an unknown energy, start or engine, a negative weight, or a stiffness out of (0, 1].
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
        volume=volume,
        area=area,
        stiffness=stiffness,
        strain=strain,
        workers=workers,
        progress=progress,
    )
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
        extra={**solution.facts(), "engine": solver.engine},
    )
