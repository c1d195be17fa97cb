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
from typing import Unpack

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.constraints import Wanted
from sshade.solver.elements import Elements
from sshade.solver.iterate import iterate
from sshade.solver.options import Energy, EnergyOptions, SolverOptions, complete, energy_options
from sshade.solver.quasi_newton import QuasiNewton
from sshade.solver.softening import Softening
from sshade.solver.solution import Solution
from sshade.solver.start import initial_guess
from sshade.task import DeformationResult, DeformationTask, Progress, silent
from sshade.threads import ThreadTeam


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

    Raises
    ------
    InputError
        On an unknown energy, or vertices as above that are out of
        range, repeated, or leave a component free.
    FloatingPointError
        When triangles have no area: their cotangents are infinite.
    """

    def __init__(self, mesh: Mesh, index: np.ndarray, *, energy: Energy = "spokes_and_rims") -> None:
        self._elements = Elements(mesh, index, energy=energy)
        self.mesh, self.index, self.energy = mesh, self._elements.index, energy

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
        max_seconds: float = inf,
        workers: int = 1,
        progress: Progress = silent,
        **energy: Unpack[EnergyOptions],
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
        max_seconds : float
            Another cutoff: no iteration begins later. The result then depends on the machine.
        workers : int
            Threads that share each iteration, from some 20,000 vertices on; no
            influence on the result.
        progress : Progress
        **energy
            Weights of the constraints, and how triangles soften; see
            :class:`sshade.solver.options.EnergyOptions`. By default neither.

        Returns
        -------
        Solution

        Raises
        ------
        TypeError
            On an unknown option.
        InputError
            On a wrong shape, a window or workers under 1, a negative weight,
            a stiffness out of (0, 1], one under 1 with spokes, or matrices that are no rotations.
        FloatingPointError
            When an iterate is not finite.
        """
        targets, start = self._checked_positions(targets, start)
        if window < 1:
            raise InputError(f"the acceleration window must be at least 1, not {window}")
        options = complete(energy)
        wanted = Wanted(options["volume"], options["area"])
        softening = Softening(options["stiffness"], options["strain"])
        u = start[self._elements.vertex] - self.mesh.origin
        u[self._elements.held] = targets - self.mesh.origin
        with ThreadTeam(workers) as team:
            iteration = self._elements.iteration(u[self._elements.held], wanted, softening, team=team)
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

    def project(
        self, positions: np.ndarray, *, volume: float = 0.0, area: float = 0.0, workers: int = 1
    ) -> np.ndarray:
        """Project positions onto the exact constraints, by what costs the energy least.

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
        with ThreadTeam(workers) as team:
            iteration = self._elements.iteration(
                targets, Wanted(volume, area).checked(), Softening(), team=team
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
    accelerate: bool = True,
    workers: int = 1,
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[SolverOptions],
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with our own accelerated local/global solver.

    Parameters
    ----------
    task : DeformationTask
    energy : {"spokes", "spokes_and_rims"}
    accelerate : bool
        Quasi-Newton steps (L-BFGS, window 5), to the same minimum in a fraction of the steps.
    workers : int
        Threads that share each iteration; no influence on the result.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Of the energy and its iteration, with their defaults: :data:`sshade.solver.options.DEFAULTS`.

    Returns
    -------
    DeformationResult
        ``extra`` holds, as of :class:`Solution`, ``rotations``, ``residual``, the energies,
        ``rejected``, and the errors and states of volume and area.

    Raises
    ------
    TypeError
        On an unknown option.
    InputError
        On an unknown energy or start, a negative weight, or a stiffness out of (0, 1].
    FloatingPointError
        When triangles have no area.
    """
    begin = perf_counter()
    solver_options = complete(options)
    guess = initial_guess(task, solver_options["start"])
    solver = LocalGlobal(task.mesh, task.handles.index, energy=energy)
    precomputed = perf_counter()
    solution = solver.solve(
        task.handles.target,
        start=guess,
        accelerate=accelerate,
        workers=workers,
        progress=progress,
        tolerance=solver_options["tolerance"],
        max_iterations=solver_options["max_iterations"],
        **energy_options(solver_options),
    )
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
        extra=solution.facts(),
    )
