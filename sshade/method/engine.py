"""The engine: sample proxies of a mesh, bind the mesh to them, solve, prolong, correct, and average.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from threading import Lock
from time import perf_counter
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, renamed, silent
from sshade.core.threads import ThreadTeam, available_cpus
from sshade.mesh.mesh import Mesh
from sshade.method.initialise import ROOM, Solve, initialised
from sshade.method.proxies import FACTS, Proxies
from sshade.method.regions import HandleRegions
from sshade.problem.options import SOLVER, Options
from sshade.problem.task import DeformationResult, DeformationTask, Handles
from sshade.proxy.binding import Binding, bind_proxy
from sshade.proxy.projection import Projector, project_to_fans
from sshade.proxy.sample import Sampling, proxy_mesh, sample_proxy
from sshade.solver.local_global import Bound, bind_task, local_global

#: Relative volume deficit of M' above which the proxy is solved again, and largest number of further solves.
VOLUME_ERROR, VOLUME_ROUNDS = 1e-3, 3
#: Largest distance of a hard handle from its target that needs no further solve, as a fraction of the
#: bounding-box diagonal.
MET = 1e-5
#: Largest area weight of the guide energy.
GUIDE_AREA = 1.0

#: Places handles of M on a proxy.
Place = Callable[[Handles], Handles]
#: Solves a proxy for handles on it: ``solve(handles, volume_goal=, tolerance=, max_iterations=)``, where the
#: goal is a multiple of the volume at rest. Each solve starts from the result of the last one.
SolveProxy = Callable[..., DeformationResult]
#: Samples a mesh: ``sample(mesh, regions, seed)``.
Sampler = Callable[[Mesh, HandleRegions, tuple[int, int]], tuple[Sampling, Place]]


def sample_with_handles(mesh: Mesh, regions: HandleRegions, seed: tuple[int, int]) -> tuple[Sampling, Place]:
    """Sample M with its handle vertices first, so that they are vertices and handles of N.

    Parameters
    ----------
    mesh : Mesh
    regions : HandleRegions
    seed : (int, int)

    Raises
    ------
    InputError
        See :func:`sshade.proxy.sample.sample_proxy`.
    """
    sampling = sample_proxy(mesh, regions.vertices, first=regions.first, seed=seed, graph=regions.metric)
    number = regions.number[sampling.samples]
    on = np.flatnonzero(number >= 0)
    return sampling, lambda handles: handles.sampled(number[on], on, mesh.V)


def solve_proxy(
    task: DeformationTask,
    options: Options,
    *,
    solve: Solve | None = None,
    coarser_progress: Progress = silent,
    **context: Any,
) -> DeformationResult:
    """Solve the task of a proxy, initialised on a coarser proxy where the options say so.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    solve : callable, optional
        Takes the place of :func:`sshade.solver.local_global.local_global`.
    coarser_progress : Progress
        Of the solve on the coarser proxy.
    **context
        ``volume_goal``, ``seed`` and ``progress`` of the solve.
    """
    context |= {"tolerance": options.tolerance, "workers": solver_threads(options)}
    with ThreadPoolExecutor(max_workers=2) as pool:
        if solve is None:
            solve = _SharedBinding(pool, options)
            solve.bind(task)
        if not options.coarser_start:
            return solve(task, **context)
        guide = None
        if options.guide_attachment:
            stiff = {"attachment": options.guide_attachment, "stiffness": 1.0}
            stiff["area"] = min(options.area, GUIDE_AREA)
            guide = partial(local_global, **{**options.subset(SOLVER), **stiff})
        coarsely = partial(deform_coarsely, seed=options.seed, progress=coarser_progress)
        return initialised(task, solve=solve, guide=guide, deform_coarsely=coarsely, **context)


def solver_threads(options: Options) -> int:
    """Return the number of threads that share an iteration on a proxy: one if samplings share the CPUs."""
    return (options.workers or available_cpus()) if options.samplings == 1 else 1


class _SharedBinding:
    """Calls of :func:`local_global` that share a solver on the same mesh; threads of a pool bind solvers."""

    def __init__(self, pool: ThreadPoolExecutor, options: Options) -> None:
        self._pool, self._options = pool, options
        self._bound: dict[int, Future[Bound]] = {}
        self._lock = Lock()

    def bind(self, task: DeformationTask) -> Future[Bound]:
        with self._lock:
            known = id(task.mesh)  # meshes live as long as their solver
            if known not in self._bound:
                self._bound[known] = self._pool.submit(bind_task, task, self._options)
            return self._bound[known]

    def __call__(self, task: DeformationTask, **context: Any) -> DeformationResult:
        bound, accelerate = self.bind(task).result(), self._options.accelerate
        solver = {**self._options.subset(SOLVER), **context}
        return local_global(task, bound=bound, accelerate=accelerate, **solver)


def deform_coarsely(
    task: DeformationTask, vertices: int, coarse: Solve, *, seed: int = 0, progress: Progress = silent
) -> DeformationResult:
    """Deform N through a coarser proxy, which the method `coarse` deforms."""
    sampling: dict[str, Any] = {"vertices": vertices, "coarser": ROOM, "samplings": 1, "seed": seed}
    return deform_once(task, Options(**sampling, frames="blended", coarse=coarse), progress=progress)


class Engine:
    """The proxies of a connected, oriented manifold for some handles.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    handles : Handles
        Only their vertices, groups and weights matter, and which handles have a rotation.
    options : Options
    sample, projection : callable
        How M is sampled, and the projection P onto a proxy.

    Attributes
    ----------
    regions : HandleRegions
        Of the present handles.
    """

    def __init__(
        self,
        mesh: Mesh,
        handles: Handles,
        options: Options,
        *,
        sample: Sampler = sample_with_handles,
        projection: Projector = project_to_fans,
    ) -> None:
        self._mesh, self._sample, self._projection = mesh, sample, projection
        self.proxies = Proxies(mesh, options, handles=len(handles))
        mesh.require_one_component()
        self._volume_goal = options.volume_goal
        self.regions = self.regions_of(handles)

    def aim(self, volume_goal: float | None) -> None:
        """Set the volume goal."""
        self._volume_goal = self.regions.volume_goal = volume_goal

    def regions_of(self, handles: Handles) -> HandleRegions:
        """Return the handle regions of M for other handles."""
        return HandleRegions(
            self._mesh,
            handles,
            vertices=self.proxies.vertices,
            graph=self.proxies.graph,
            volume_goal=self._volume_goal,
        )

    def bind(
        self,
        number: int,
        pool: ThreadPoolExecutor,
        solver_of: Callable[[Mesh, Sampling, Place], SolveProxy],
    ) -> BoundProxy:
        """Sample a proxy and make its solver; a thread of `pool` binds M to the proxy meanwhile."""
        begin = perf_counter()
        sampling, place = self._sample(self._mesh, self.regions, (self.proxies.seed, number))
        seconds = perf_counter() - begin

        def bind() -> Binding:
            frames = self.proxies.frames
            binding = bind_proxy(self._mesh, sampling, frames=frames, projection=self._projection)
            self.regions.prepare()
            return binding

        bound, proxy = pool.submit(bind), proxy_mesh(self._mesh, sampling)
        made = BoundProxy(proxy, sampling, place, solver_of(proxy, sampling, place), bound, seconds)
        made.aim(self._volume_goal)
        return made

    def average(
        self, deform: Callable[[int], DeformationResult], handles: Handles, options: Options
    ) -> DeformationResult:
        """Average the samplings' M', and put it on its targets or correct its volume."""
        mean, regions = self.proxies.average(deform), self.regions
        if corrects_volume(options):  # then each M' is on its targets
            V = regions.correct_volume(mean.vertices)
        else:
            V = regions.on_targets(mean.vertices, handles)
        return mean if V is mean.vertices else replace(mean, vertices=V)


def corrects_volume(options: Options) -> bool:
    """Whether the volume deficit of M' is corrected where handles are regions."""
    return options.volume == inf and options.coarse is None


@dataclass
class BoundProxy:
    """A proxy N of a mesh M, its solver, and the binding of M to N.

    Parameters
    ----------
    proxy : Mesh
    sampling : Sampling
    place : callable
        Places handles of M on N. An optional method ``learn(handles, V)`` corrects later placements for the
        distance of M' from the targets, and returns the largest distance; ``forget()`` ends the corrections.
    solver : callable
        A :data:`SolveProxy`; in a Deformer a :class:`sshade.method.drag.Drag`.
    bound : Future of Binding
    sampling_seconds : float
    goal : float
        Volume of N' as a multiple of the volume of N, with which M' has the volume of M, or the volume that
        the user wants.
    first_goal : float
        Goal before any correction.
    """

    proxy: Mesh
    sampling: Sampling
    place: Place
    solver: Any
    bound: Future[Binding]
    sampling_seconds: float
    goal: float = 1.0
    first_goal: float = 1.0

    def aim(self, volume_goal: float | None) -> None:
        """Begin with the user's goal."""
        self.goal = self.first_goal = 1.0 if volume_goal is None else volume_goal

    def restart(self) -> None:
        """Forget the corrections of the goal and of places."""
        self.goal = self.first_goal
        if forget := getattr(self.place, "forget", None):
            forget()

    @property
    def binding(self) -> Binding:
        """The binding of M, once it is made."""
        return self.bound.result()

    def solve(self, handles: Handles, **stop: Any) -> DeformationResult:
        """Solve N for handles of M at their targets.

        Raises
        ------
        InputError
            Where the handles cannot be placed on N.
        """
        placed = self.place(handles)
        if handles.prescribed_rotations and not placed.prescribed_rotations:
            raise InputError("no handle with a rotation is a vertex of the proxy; raise the option vertices")
        return self.solver(placed, volume_goal=self.goal, **stop)

    def deform(
        self,
        handles: Handles,
        regions: HandleRegions,
        options: Options,
        *,
        again: bool,
        team: ThreadTeam,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform M for handles at their targets.

        A proxy has few vertices inside of handle regions. M' may then lose volume, although N' keeps
        the volume of N. Another solve with a corrected volume goal removes the deficit. So it is with the
        volume that the user wants. In the same way, further solves bring handles that are no vertices of N
        to their targets.

        Parameters
        ----------
        handles : Handles
            Of M.
        regions : HandleRegions
        options : Options
            `max_iterations` limits all solves together.
        again : bool
            Solve again at once where M' needs a correction. Without it, the next call makes the correction.
        team : ThreadTeam
            Threads that prolong N' to M'.
        out : (n, 3) float64, C-contiguous, optional
            Takes the prolonged positions.
        """
        corrects = corrects_volume(options)
        scale = abs(regions.volume) or 1.0 if corrects else 1.0
        iterations, seconds = 0.0, {"solve": 0.0, "carry": 0.0}
        best, smallest, was_exact, solver_facts = None, inf, False, dict[str, Any]()
        for _ in range(1 + VOLUME_ROUNDS if again else 1):
            begin = perf_counter()
            left = int(options.max_iterations - iterations)
            solved = self.solve(handles, tolerance=options.tolerance, max_iterations=left)
            seconds["solve"] += perf_counter() - begin
            iterations += solved.iterations
            exact, R = solved.extra.get("volume_constraint") == "exact", solved.extra.get("rotations")
            binding = self.binding
            begin = perf_counter()
            V, degenerate = binding.carry(solved.vertices, rotations=R, team=team, out=out)
            V = regions.on_targets(V, handles) if corrects else V
            deficit = regions.volume_deficit(V) if corrects else 0.0
            missing = abs(deficit) / scale
            seconds["carry"] += perf_counter() - begin
            worse = missing > max(smallest, VOLUME_ERROR)
            if best is not None and (worse or (was_exact and not exact)):
                break  # the last shape was better
            solver_facts |= solved.extra
            best, smallest, was_exact = (V, solved.converged, degenerate), missing, exact
            corrected = missing <= VOLUME_ERROR or not exact
            if not corrected:
                goal = self.goal + deficit / self.proxy.volume  # an exact constraint needs a volume
                corrected = goal <= 0
                self.goal = self.goal if corrected else goal
            learn = getattr(self.place, "learn", None)
            missed = learn(handles, V) if learn else 0.0
            met = missed <= MET * binding.mesh.diagonal
            if (corrected and met) or iterations >= options.max_iterations:
                break
        assert best is not None
        V, converged, degenerate = best
        facts = {
            "proxy_vertices": self.proxy.n,
            "degenerate_frames": degenerate,
            "residual": solver_facts.get("residual", float("nan")),
            **{f"proxy_{name}": fact for name, fact in solver_facts.items() if f"proxy_{name}" in FACTS},
        }
        if "energy" in solver_facts:
            facts["energy"] = solver_facts["energy"]
        return DeformationResult(V, iterations, converged, seconds, facts)


def deform_once(
    task: DeformationTask, options: Options, *, progress: Progress = silent, **hooks: Any
) -> DeformationResult:
    """Deform a connected, oriented manifold through proxies that serve this deformation alone.

    Projection and encoding of M run in a thread beside the solve, and samplings run in parallel.

    Parameters
    ----------
    task : DeformationTask
        With a vertex that is no hard handle.
    options : Options
    progress : Progress
    **hooks
        `sample` and `projection`, see :class:`Engine`.

    Returns
    -------
    DeformationResult
        See :func:`sshade.deform`.

    Raises
    ------
    InputError
        On another mesh, or where it cannot be sampled or solved.
    """
    engine = Engine(task.mesh, task.handles, options, **hooks)

    def deform(number: int) -> DeformationResult:
        stage = "proxy" if options.samplings == 1 else f"proxy {number + 1}"
        progress(stage, 0, options.max_iterations)
        context: dict[str, Any] = {"seed": options.seed, "progress": renamed(progress, stage)}
        coarser = renamed(progress, f"coarser {stage}")

        def solver_of(proxy: Mesh, sampling: Sampling, place: Place) -> SolveProxy:
            start = first.result().vertices if first is not None and number else task.guess
            guess, name = None if start is None else start[sampling.samples], f"{task.name} proxy {number}"

            def solve(handles: Handles, *, volume_goal: float, **stop: Any) -> DeformationResult:
                nonlocal guess
                on_proxy = DeformationTask(name, proxy, handles, guess=guess)
                if options.coarse is not None:
                    return options.coarse(on_proxy, **context)
                own, more = replace(options, **stop), {"coarser_progress": coarser, **context}
                result = solve_proxy(on_proxy, own, volume_goal=volume_goal, **more)
                guess = result.vertices  # the next solve starts there
                return result

            return solve

        with ThreadPoolExecutor(max_workers=1) as pool, ThreadTeam(engine.proxies.carriers) as team:
            bound = engine.bind(number, pool, solver_of)
            result = bound.deform(task.handles, engine.regions, options, again=True, team=team)
        seconds = {"remesh": bound.sampling_seconds, **bound.binding.seconds, **result.seconds}
        extra = {**result.extra, "added_samples": bound.sampling.added}
        return replace(result, seconds=seconds, extra=extra)

    first: Future[DeformationResult] | None = None
    with ThreadPoolExecutor(max_workers=1) as leader:
        first = leader.submit(deform, 0) if options.warm_start else None

        def run(number: int) -> DeformationResult:
            return first.result() if first is not None and number == 0 else deform(number)

        return engine.average(run, task.handles, options)
