"""As-rigid-as-possible deformation by a local/global solver of our own, with quasi-Newton steps.

The mesh and the choice of handle vertices are bound once (:class:`LocalGlobal`:
weights, terms, factorisation or not), then solved for any number of handle positions. All
heavy steps run without the GIL: solvers in several threads proceed at the same time.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", 2007 (spokes);
I. Chao, U. Pinkall, P. Sanan, P. Schroeder, "A simple geometric model for
elastic deformations", 2010 (spokes and rims: the paper's "Elastic").
"""

from __future__ import annotations

from copy import copy
from math import inf
from time import perf_counter
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.options import ENERGY, Energy, complete
from sshade.progress import Progress, silent
from sshade.solver.arap import ArapIteration, ArapSystem
from sshade.solver.attachment import Attachment
from sshade.solver.constraints import Components, VolumeArea
from sshade.solver.quasi_newton import QuasiNewton, iterate
from sshade.solver.solution import Solution
from sshade.solver.start import initial_guess
from sshade.solver.strain_softening import StrainSoftening
from sshade.solver.terms import Triangles
from sshade.task import DeformationResult, DeformationTask
from sshade.threads import ThreadTeam

#: Vertices up to which :func:`local_global` factorises by default. At 170,000 V-cycles take as long, in a
#: sixth of the memory, at 680,000 half as long.
FACTORISED = 100_000
#: Of a solve without a factorisation: so many decide which minimum it ends in. With 5, some bodies whose
#: handles were torn far away ended in higher ones.
EXACT_STEPS = 20


class LocalGlobal:
    """Minimises an as-rigid-as-possible energy under prescribed vertex positions.

    Parameters
    ----------
    mesh : Mesh
        Rest shape. May have a boundary, and triangles without area: see
        :func:`sshade.solver.cotangents.half_cotangents`.
    index : (k,) int
        Vertices with prescribed positions, each once, at least one per component.
    energy : {"spokes", "spokes_and_rims"}
        Sorkine and Alexa's energy ("ARAP"), or Chao et al.'s ("Elastic"), both
        with raw cotangents: ``sum_i sum_{ij} w_ij |e'_ij - R_i e_ij|^2``, and
        ``sum_i sum_{t at i} sum_{kl in t} h_t(kl) |e'_kl - R_i e_kl|^2``. The
        first can be negative where angles are obtuse.
    stiffness : (k,) float64, optional
        Of soft handles, see :attr:`sshade.Handles.stiffness`; by default inf, which is a hard one.
    multigrid : bool
        Global steps by a V-cycle, which is set up in each solve, in place of a factorisation: linear in
        time and memory, and quicker to low energies where triangles soften. Such a plain iteration
        does not end in the minimum for its rotations, but moves towards it: see
        :mod:`sshade.solver.global_step`.
    exact_steps : int
        With multigrid, so many first steps are all but exact, for a start far from the minimum; and so is the
        one whose residual ends a solve, which therefore is that of a factorisation.
    bending : float
        Length over which the energy of bending spreads a fold, over the square root of the mesh's area; by
        default 0, none. Not with multigrid. See :mod:`sshade.solver.bending`.

    Raises
    ------
    InputError
        On an unknown energy, a bending that is no such length, vertices as above that are out of range,
        repeated, or leave a component free, or a Laplacian that is not positive definite to rounding.
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
    ) -> None:
        self.system = ArapSystem(
            mesh,
            index,
            energy=energy,
            stiffness=stiffness,
            multigrid=multigrid,
            exact_steps=exact_steps,
            bending=bending,
        )
        self.mesh, self.index = mesh, self.system.index
        terms = self.system.terms
        shared = terms.corners if isinstance(terms, Triangles) else None
        self._components = Components(mesh, self.system.place, shared)

    def with_handles(self, index: np.ndarray, *, stiffness: np.ndarray | None = None) -> LocalGlobal:
        """The solver of the same mesh and energy with other handles, by a new factorisation.

        What does not depend on handles is shared: both may be used.

        Parameters
        ----------
        index, stiffness
            As for the class.

        Raises
        ------
        InputError
            As for the class, but of the energy.
        """
        other = copy(self)
        other.system = self.system.with_handles(index, stiffness=stiffness)
        other.index = other.system.index
        return other

    def solve(
        self,
        targets: np.ndarray,
        *,
        start: np.ndarray | None = None,
        rotations: np.ndarray | None = None,
        prescribed: tuple[np.ndarray, np.ndarray] | None = None,
        fraction: np.ndarray | None = None,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
        accelerate: bool = True,
        window: int = 5,
        max_seconds: float = inf,
        volume_goal: float = 1.0,
        workers: int = 1,
        progress: Progress = silent,
        **energy: Any,
    ) -> Solution:
        """Iterate local and global steps to a residual.

        The residual is the largest move of a vertex in one *plain* iteration
        over the rest shape's diagonal, also under acceleration; with multigrid and no exact steps, of one
        by a V-cycle. The safeguard compares energies after local steps: where an accelerated iterate has a
        higher one than the iterate before, or cannot be projected onto the exact
        constraints, half of its step is tried, and then the plain one takes its
        place. Deterministic, and safe to call from several threads at once.

        Parameters
        ----------
        targets : (k, 3) float64
            Positions of the handle vertices, in the order of `index`.
        start : (n, 3) float64, optional
            Where to begin, by default the rest shape; hard handles go to their targets first.
        rotations : (n, 3, 3) float64, optional
            Those of an earlier solution near `start`: from there the first local
            step is as quick as the others, and it ends in the same rotations.
        prescribed : ((j,) int, (j, 3, 3) float64), optional
            Vertices, each once, whose rotations are given: the local step leaves them as they are. As of
            :attr:`sshade.Handles.prescribed_rotations`.
        fraction : (k,) float64, optional
            Of the stiffness of each soft handle, in [0, 1], by default 1. The system is the same, so that a
            pull may vary from solve to solve.
        tolerance : float
            Residual under which iteration stops. 0 never stops early.
        max_iterations : int
        accelerate : bool
            Quasi-Newton steps, L-BFGS; see :mod:`sshade.solver.quasi_newton`.
        window : int
            Steps that they remember.
        max_seconds : float
            Another cutoff: no iteration begins later. The result then depends on the machine.
        volume_goal : float
            The volume to be held, where one is, over that of the rest shape; positive.
        workers : int
            Threads that share each iteration, from some 20,000 vertices on; no
            influence on the result.
        progress : Progress
        **energy
            Weights of the constraints, and how triangles soften; see
            :data:`sshade.options.ENERGY`. By default neither.

        Returns
        -------
        Solution

        Raises
        ------
        TypeError
            On an unknown option.
        InputError
            On a wrong shape, a window or workers under 1, a negative weight, a goal of no volume,
            a stiffness out of (0, 1], one under 1 with spokes, or matrices that are no rotations.
        FloatingPointError
            When an iterate is not finite.
        """
        targets, start = self.checked_positions(targets, start)
        if window < 1:
            raise InputError(f"the acceleration window must be at least 1, not {window}")
        if not 0 < volume_goal < inf:
            raise InputError(f"the volume to be held must be positive, not {volume_goal} times that at rest")
        u = self.to_system(start, targets)
        del start  # which may be the caller's last, of no more use
        with ThreadTeam(workers) as team:
            held, iteration = self.iteration(
                targets,
                team=team,
                volume_goal=volume_goal,
                prescribed=prescribed,
                fraction=fraction,
                **energy,
            )
            if rotations is not None:
                iteration.begin_with(rotations)
            facts = iterate(
                iteration,
                u,
                mixer=self._mixer(iteration, window, team) if accelerate else None,
                tolerance=tolerance,
                max_iterations=max_iterations,
                deadline=perf_counter() + max_seconds,
                progress=progress,
            )
        return self.solution(iteration, u, targets, held, volume_goal, facts)

    def _mixer(self, iteration: ArapIteration, window: int, team: ThreadTeam) -> QuasiNewton:
        unit, single = self.mesh.diagonal, self.system.factorised is None
        return QuasiNewton(self.mesh.n, window, iteration.gradient, unit=unit, single=single, team=team)

    def iteration(
        self, targets: np.ndarray, *, team: ThreadTeam, volume_goal: float, **options: Any
    ) -> tuple[VolumeArea, ArapIteration]:
        """What is held, and an iteration with these options of it and of the energy."""
        given = {name: options.pop(name) for name in ENERGY if name in options}
        asked, system = complete(given, ENERGY), self.system
        held = VolumeArea(asked.volume, asked.area)
        softening = StrainSoftening(asked.stiffness, asked.strain, asked.strain_limit)
        iteration = ArapIteration(
            system,
            targets - self.mesh.origin,
            team=team,
            constraints=self._components.held(
                held,
                corners=system.terms.corners.shape[1],
                team=team,
                volume_goal=volume_goal,
                single=system.factorised is None and not system.exact_steps,
            ),
            softening=softening.of(system.terms, system.rest),
            **options,
        )
        return held, iteration

    def solution(
        self,
        iteration: ArapIteration,
        u: np.ndarray,
        targets: np.ndarray,
        held: VolumeArea,
        volume_goal: float,
        facts: dict[str, Any],
    ) -> Solution:
        """What an iteration has come to: its positions u, in the system's order, and the rest."""
        R = np.take(iteration.R, self.system.place, axis=0).reshape(-1, 3, 3)
        errors = self._components.errors(u, volume_goal=volume_goal)
        states = self._components.status(held, errors)
        return Solution(
            positions=self.from_system(u, targets),
            rotations=R,
            volume_error=errors.volume,
            area_error=errors.area,
            volume_constraint=states[0],
            area_constraint=states[1],
            **facts,
        )

    def project(
        self, positions: np.ndarray, *, volume: float = 0.0, area: float = 0.0, workers: int = 1
    ) -> np.ndarray:
        """Project positions onto the exact constraints, by what costs the energy least, multigrid nearly so.

        Parameters
        ----------
        positions : (n, 3) float64
            Near a shape that fulfils them. Hard handles stay.
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
        targets, positions = self.checked_positions(np.asarray(positions)[self.index], positions)
        system, u = self.system, self.to_system(positions, targets)
        with ThreadTeam(workers) as team:
            corners = system.terms.corners.shape[1]
            held = self._components.held(VolumeArea(volume, area), corners=corners, team=team)
            around = targets - self.mesh.origin
            ArapIteration(system, around, team=team, constraints=held).project(u)
        return self.from_system(u, targets)

    def to_system(self, positions: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n, 3) in the system's order, about the mesh's origin, hard handles on their targets."""
        u = positions[self.system.vertex] - self.mesh.origin
        u[self.system.held] = targets[self.system.hard] - self.mesh.origin
        return u

    def from_system(self, u: np.ndarray, targets: np.ndarray) -> np.ndarray:
        positions = np.take(u, self.system.place, axis=0) + self.mesh.origin
        hard = self.system.hard
        positions[self.index[hard]] = targets[hard]
        return positions

    def checked_positions(
        self, targets: np.ndarray, start: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Targets (k, 3) and a start (n, 3), by default the rest shape; InputError where they are no such."""
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
    factorised: bool | None = None,
    volume_goal: float = 1.0,
    workers: int = 1,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Minimise an as-rigid-as-possible energy with our own accelerated local/global solver.

    Parameters
    ----------
    task : DeformationTask
    energy : {"spokes", "spokes_and_rims"}
    accelerate : bool
        Quasi-Newton steps (L-BFGS, window 5), to the same minimum in a fraction of the steps.
    factorised : bool, optional
        Global steps by a factorisation of the Laplacian; else by V-cycles, after :data:`EXACT_STEPS` steps
        that are all but exact, in memory that grows like the mesh, to the same minimum but for what the
        tolerance leaves open. By default up to :data:`FACTORISED` vertices, and with bending, which needs it.
    volume_goal : float
        The volume to be held, where one is, over that of the rest shape; positive.
    workers : int
        Threads that share each iteration; no influence on the result.
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Of the energy and its iteration: :data:`sshade.options.SOLVER`, by default the published energy.

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
        On an unknown energy or start, a negative weight or length, or a stiffness out of (0, 1].
    FloatingPointError
        When an iterate is not finite.
    """
    begin = perf_counter()
    solver_options = complete(options)
    bends = solver_options.bending > 0
    multigrid = not factorised if factorised is not None else task.mesh.n > FACTORISED and not bends
    guess = initial_guess(task, solver_options.start)
    attachment = Attachment(task.mesh, task.handles, solver_options.attachment, fold=True)
    targets, _ = attachment.pulls(task.handles.target, task.handles.rotation)
    solver = LocalGlobal(
        task.mesh,
        attachment.vertex,
        energy=energy,
        stiffness=attachment.stiffness,
        multigrid=multigrid,
        exact_steps=EXACT_STEPS,
        bending=solver_options.bending,
    )
    precomputed = perf_counter()
    solution = solver.solve(
        targets,
        start=guess,
        prescribed=task.handles.prescribed_rotations,
        accelerate=accelerate,
        volume_goal=volume_goal,
        workers=workers,
        progress=progress,
        tolerance=solver_options.tolerance,
        max_iterations=solver_options.max_iterations,
        **solver_options.subset(ENERGY),
    )
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds={"precompute": precomputed - begin, "solve": perf_counter() - precomputed},
        extra=solution.facts(),
    )
