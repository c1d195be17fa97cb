"""The engine: sample proxies of a mesh, bind it to them, solve, carry the mesh, correct, and average.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import Any, NamedTuple, Protocol

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.carry.projection import Projector, project_to_fans
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.options import SOLVER, Options
from sshade.pipeline.initialise import ROOM, Solve, initialised
from sshade.pipeline.proxies import FACTS, Proxies
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.progress import Progress, silent
from sshade.sampling.proxy import Sampling, proxy_mesh
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask, Handles
from sshade.threads import ThreadTeam

#: Relative volume deficit of M' above which the proxy is solved again, and largest number of such solves.
VOLUME_ERROR, VOLUME_ROUNDS = 1e-3, 3
#: Largest distance of a hard handle from its target that needs no other solve (x diagonal).
MET = 1e-5
#: Largest area weight of the guide energy.
GUIDE_AREA = 1.0

#: Gives a proxy the handles of M.
Place = Callable[[Handles], Handles]
#: Samples a mesh, and places handles on the proxy: ``sample(mesh, regions, seed)``.
Sampler = Callable[[Mesh, HandleRegions, tuple[int, int]], tuple[Sampling, Place]]


def sample_with_handles(mesh: Mesh, regions: HandleRegions, seed: tuple[int, int]) -> tuple[Sampling, Place]:
    """Sample M with its handle vertices first, so that they are vertices and handles of N.

    Parameters
    ----------
    mesh : Mesh
    regions : HandleRegions
    seed : (int, int)
    """
    sampling, number = regions.sample(seed)
    on = np.flatnonzero(number >= 0)
    return sampling, lambda handles: handles.sampled(number[on], on, mesh.V)


class ProxySolver(Protocol):
    """Solves one proxy, each time from the result of the last solve."""

    #: Volume to keep, as a multiple of the proxy's volume at rest.
    volume_goal: float

    def __call__(self, handles: Handles, *, tolerance: float, max_iterations: int) -> DeformationResult:
        """Deform N for handles on N at their targets."""


class SingleSolve:
    """Solves a proxy for targets that are known from the beginning.

    Parameters
    ----------
    proxy : Mesh
    options : Options
        With a `coarse` method, that method solves.
    name : str
        Of the task, for logs.
    guess : (k, 3) float64, optional
        Where the first solve starts instead of at ``options.start``.
    progress : Progress
    """

    def __init__(
        self, proxy: Mesh, options: Options, *, name: str, guess: np.ndarray | None, progress: Progress
    ) -> None:
        self._proxy, self._options, self._name, self._guess = proxy, options, name, guess
        self._progress, self.volume_goal = progress, 1.0

    def __call__(self, handles: Handles, *, tolerance: float, max_iterations: int) -> DeformationResult:
        task = DeformationTask(self._name, self._proxy, handles, guess=self._guess)
        context: Any = {"seed": self._options.seed, "progress": self._progress}
        if self._options.coarse is not None:
            return self._options.coarse(task, **context)
        options = replace(self._options, tolerance=tolerance, max_iterations=max_iterations)
        result = solve_proxy(task, options, volume_goal=self.volume_goal, **context)
        self._guess = result.vertices
        return result


def solve_proxy(
    task: DeformationTask, options: Options, *, solve: Solve | None = None, **context: Any
) -> DeformationResult:
    """Solve the task of a proxy, initialised on a coarser proxy where the options say so.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    solve : callable, optional
        Takes the place of :func:`sshade.solver.local_global.local_global`.
    **context
        ``volume_goal``, ``seed`` and ``progress`` of the solve.
    """
    energy = options.subset(SOLVER)
    tolerance = energy.pop("tolerance")
    if solve is None:
        solve = partial(local_global, accelerate=options.accelerate, **energy)
    if not options.coarser_start:
        return solve(task, tolerance=tolerance, **context)
    guide = None
    if options.guide_attachment:
        stiff = {"attachment": options.guide_attachment, "stiffness": 1.0}
        area = min(options.area, GUIDE_AREA)
        guide = partial(local_global, **{**energy, **stiff, "area": area})
    coarsely = partial(deform_coarsely, seed=options.seed)
    return initialised(
        task, solve=solve, guide=guide, deform_coarsely=coarsely, tolerance=tolerance, **context
    )


def deform_coarsely(
    task: DeformationTask, vertices: int, coarse: Solve, *, seed: int = 0
) -> DeformationResult:
    """Deform N through a proxy of its own, which the method `coarse` deforms."""
    sampling: dict[str, Any] = {"vertices": vertices, "coarser": ROOM, "samplings": 1, "seed": seed}
    return deform_once(task, Options(**sampling, frames="blended", coarse=coarse))


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
        self.regions = self.regions_of(handles)

    def regions_of(self, handles: Handles) -> HandleRegions:
        """Return the handle regions of M for other handles."""
        return HandleRegions(self._mesh, handles, vertices=self.proxies.vertices, graph=self.proxies.graph)

    def bind(self, number: int, pool: ThreadPoolExecutor) -> BoundProxy:
        """Sample a proxy; a thread of `pool` binds M to it."""
        begin = perf_counter()
        sampling, place = self._sample(self._mesh, self.regions, (self.proxies.seed, number))
        seconds = perf_counter() - begin

        def bound() -> Binding:
            frames = self.proxies.frames
            binding = bind_proxy(self._mesh, sampling, frames=frames, projection=self._projection)
            self.regions.prepare()
            return binding

        return BoundProxy(proxy_mesh(self._mesh, sampling), sampling, place, pool.submit(bound), seconds)

    def average(
        self,
        deform: Callable[[int], DeformationResult],
        handles: Handles,
        regions: HandleRegions,
        options: Options,
    ) -> DeformationResult:
        """Average the samplings' M', and put it on its targets or correct its volume."""
        mean = self.proxies.average(deform)
        if corrects_volume(options):  # then each M' is on its targets
            V = regions.correct_volume(mean.vertices)
        else:
            V = regions.on_targets(mean.vertices, handles)
        return mean if V is mean.vertices else replace(mean, vertices=V)


def corrects_volume(options: Options) -> bool:
    """Whether the volume deficit of M' is corrected where handles are regions."""
    return options.volume == inf and options.coarse is None


class _Carried(NamedTuple):
    """N' as solved, M' (n, 3) carried with it, degenerate frames, and the volume deficit of M'."""

    solved: DeformationResult
    V: np.ndarray
    degenerate: int
    deficit: float

    @property
    def exact(self) -> bool:
        """Whether N' has its volume exactly."""
        return self.solved.extra.get("volume_constraint") == "exact"


class BoundProxy:
    """A proxy N of a mesh M, and the binding of M to N.

    Parameters
    ----------
    proxy : Mesh
    sampling : Sampling
    place : callable
        Gives N the handles of M. Its attribute `learn`, if any, is told where handles missed their targets.
    binding : Future of Binding
    seconds : float
        Time of the sampling.
    """

    def __init__(
        self, proxy: Mesh, sampling: Sampling, place: Place, binding: Future[Binding], seconds: float
    ) -> None:
        self.proxy, self.sampling, self.place, self._seconds = proxy, sampling, place, seconds
        self._binding = binding

    @property
    def binding(self) -> Binding:
        """The binding of M, once it is made."""
        return self._binding.result()

    def seconds(self) -> dict[str, float]:
        """Return the times of sampling and binding."""
        return {"remesh": self._seconds, **self.binding.seconds}

    def placing(self, place: Place) -> BoundProxy:
        """Return this proxy with another placement of handles."""
        return BoundProxy(self.proxy, self.sampling, place, self._binding, self._seconds)

    def solve(self, handles: Handles, solver: ProxySolver, **stop: Any) -> DeformationResult:
        """Solve N for handles of M at their targets.

        Raises
        ------
        InputError
            Where the handles cannot be placed on N.
        """
        placed = self.place(handles)
        if handles.prescribed_rotations and not placed.prescribed_rotations:
            raise InputError("no handle with a rotation is a vertex of the proxy; ask for more vertices")
        return solver(placed, **stop)

    def deform(
        self,
        handles: Handles,
        regions: HandleRegions,
        solver: ProxySolver,
        options: Options,
        *,
        again: bool,
        team: ThreadTeam,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform M for handles at their targets.

        A proxy has few vertices inside of handle regions. M' then has another volume than M, although N' has
        that of N. Another solve with a corrected volume goal removes the deficit. In the same way, handles
        that are no vertices of N come to their targets.

        Parameters
        ----------
        handles : Handles
            Of M.
        regions : HandleRegions
        solver : ProxySolver
        options : Options
            Here `tolerance` and `max_iterations` are those of all solves together.
        again : bool
            Solve again at once where M' needs a correction, and not only in the next call.
        team : ThreadTeam
            Carries M.
        out : (n, 3) float64, C-contiguous, optional
            Takes the carried positions.
        """
        best: _Carried | None = None
        iterations, seconds = 0.0, {"solve": 0.0, "carry": 0.0}
        for _ in range(1 + VOLUME_ROUNDS if again else 1):
            begin = perf_counter()
            left = int(options.max_iterations - iterations)
            solved = self.solve(handles, solver, tolerance=options.tolerance, max_iterations=left)
            seconds["solve"] += perf_counter() - begin
            iterations += solved.iterations
            binding = self.binding
            begin = perf_counter()
            R = solved.extra.get("rotations")
            V, degenerate = binding.carry(solved.vertices, rotations=R, team=team, out=out)
            deficit = 0.0
            if corrects_volume(options):
                V = regions.on_targets(V, handles)
                deficit = regions.volume_deficit(V)
            seconds["carry"] += perf_counter() - begin
            carried, error = _Carried(solved, V, degenerate, deficit), VOLUME_ERROR * abs(regions.volume)
            if best is not None:
                larger = abs(deficit) > max(abs(best.deficit), error)
                if larger or (best.exact and not carried.exact):
                    break
                solved = replace(solved, extra={**best.solved.extra, **solved.extra})
            best = carried._replace(solved=solved)
            goal = solver.volume_goal + (deficit / self.proxy.volume if deficit else 0.0)
            corrected = abs(deficit) <= error or not carried.exact or goal <= 0
            if not corrected:
                solver.volume_goal = goal
            learn = getattr(self.place, "learn", None)
            missed = learn(handles, V) if learn else 0.0
            met = missed <= MET * binding.mesh.diagonal
            if (corrected and met) or iterations >= options.max_iterations:
                break
        assert best is not None
        known = best.solved.extra
        facts = {
            "proxy_vertices": self.proxy.n,
            "degenerate_frames": best.degenerate,
            "residual": known.get("residual", float("nan")),
            **{f"proxy_{name}": fact for name, fact in known.items() if f"proxy_{name}" in FACTS},
        }
        if "energy" in known:
            facts["energy"] = known["energy"]
        return DeformationResult(best.V, iterations, best.solved.converged, seconds, facts)


def deform_once(
    task: DeformationTask,
    options: Options,
    *,
    progress: Progress = silent,
    sample: Sampler = sample_with_handles,
    projection: Projector = project_to_fans,
) -> DeformationResult:
    """Deform a connected, oriented manifold through proxies that are let go of afterwards.

    Projection and encoding of M run in a thread beside the solve, and samplings run in parallel.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    progress : Progress
    sample, projection : callable
        See :class:`Engine`.

    Returns
    -------
    DeformationResult
        See :func:`sshade.deform`.

    Raises
    ------
    InputError
        On another mesh, or where it cannot be sampled or solved.
    """
    engine = Engine(task.mesh, task.handles, options, sample=sample, projection=projection)
    if engine.regions.covered:
        return all_on_targets(task)
    first: Future[np.ndarray] = Future()  # M' of the first sampling

    def deform(number: int) -> DeformationResult:
        with ThreadPoolExecutor(max_workers=1) as pool, ThreadTeam(engine.proxies.carriers) as team:
            proxy = engine.bind(number, pool)
            guess = first.result() if options.warm_start and number else task.guess
            solver = SingleSolve(
                proxy.proxy,
                options,
                name=f"{task.name} proxy {number}",
                guess=None if guess is None else guess[proxy.sampling.samples],
                progress=lambda _, done, total, note="": progress(
                    f"sampling {number + 1}", done, total, note
                ),
            )
            result = proxy.deform(task.handles, engine.regions, solver, options, again=True, team=team)
        extra = {**result.extra, "added_samples": proxy.sampling.added}
        return replace(result, seconds={**proxy.seconds(), **result.seconds}, extra=extra)

    def deform_first(number: int) -> DeformationResult:
        try:
            result = deform(number)
        except BaseException as error:
            if number == 0:
                first.set_exception(error)
            raise
        if number == 0:
            first.set_result(result.vertices)
        return result

    run = deform_first if options.warm_start else deform
    return engine.average(run, task.handles, engine.regions, options)
