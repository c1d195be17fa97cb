"""Solve a proxy for one deformation: from a coarser proxy, and from a local minimum of a guide energy.

Large motions need many local/global iterations but little detail. A proxy with a sixth of the vertices
finds them in a sixth of the time, at a tenth of the accuracy; the solve on the full proxy then starts near
its minimum.

The initialisation also decides which minimum is found, because handles alone do not say to which side a
knee bends. On the coarsest proxy the solver therefore minimises a guide energy first, in which handles
attach whole parts of the body. It also starts once from the rest shape or the rigid motion of the handles.
The second result is used only where its energy is clearly lower. More starts do not pay: they end lower by
more than a few per cent only where a far twist collapses and intersects itself.
"""

from __future__ import annotations

import logging
from concurrent.futures import CancelledError
from dataclasses import replace
from functools import partial
from threading import Event
from typing import Protocol

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import SMALL, Later, available_cpus, beside
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.method.regions import HandleRegions, sample_with_handles
from sshade.problem.options import Options
from sshade.problem.stop import Stop
from sshade.problem.task import DeformationTask, Handles
from sshade.proxy.binding import bind_proxy, frame_maker
from sshade.proxy.sample import proxy_mesh, proxy_vertices
from sshade.solver.local_global import prepare, solve_task
from sshade.solver.solution import Solution

log = logging.getLogger(__name__)

#: Number of vertices below which a coarser proxy saves no time.
SMALLEST = 3000
#: Ratio of a proxy's vertices to its coarser proxy's, and smallest ratio of the coarser proxy's vertices to
#: handles. ROOM is also the smallest ratio of vertices where many handles enlarge the coarser proxy.
RATIO, ROOM = 6, 2
#: Tolerance on the coarser proxy, as a multiple of the tolerance asked for.
ROUGH = 10.0
#: Ratio of energies below which the result from the plain start replaces the result from the guide.
CLEARLY_LOWER = 0.9
#: Largest area weight of the guide energy.
GUIDE_AREA = 1.0


class Solve(Protocol):
    """Solves the task of a proxy, from the task's guess if it has one.

    If `softened`, the guess is near the minimum: see :func:`sshade.solver.local_global.solve`.
    """

    def __call__(
        self, task: DeformationTask, *, stop: Stop, progress: Progress, softened: bool = False
    ) -> Solution: ...


class ProxySolver(Protocol):
    """Solves a proxy for handles on it.

    The goal is the volume of N', as a multiple of the volume of N. Each solve starts from the result of the
    last one. To try another method on the proxy, pass it as the option `coarse`. To try another solver, make
    it in :class:`sshade.method.proxy.Proxy` in place of :class:`OnceSolver`.
    """

    def __call__(self, handles: Handles, *, volume_goal: float, stop: Stop) -> Solution: ...


class OnceSolver:
    """Solve a proxy for one deformation, by our solver or by the user's method ``options.coarse``.

    Parameters
    ----------
    proxy : Mesh
        N.
    options : Options
    guess : (k, 3) float64, optional
        Shape in which the first solve starts; by default as the options say.
    progress, coarser_progress : Progress
    """

    def __init__(
        self,
        proxy: Mesh,
        options: Options,
        *,
        guess: np.ndarray | None = None,
        progress: Progress = silent,
        coarser_progress: Progress = silent,
    ) -> None:
        self._proxy = proxy
        self._options = options
        self._guess = guess
        self._progress = progress
        self._coarser_progress = coarser_progress

    def __call__(self, handles: Handles, *, volume_goal: float, stop: Stop) -> Solution:
        task = DeformationTask("proxy", self._proxy, handles, guess=self._guess)
        options, progress = self._options, self._progress
        if options.coarse is not None:
            return Solution.of_method(options.coarse(task, seed=options.seed, progress=progress))
        workers = solver_threads(options, self._proxy.n)
        set_up = partial(prepare, task, options, volume_goal=volume_goal)
        with beside(set_up, size=self._proxy.n) as prepared:
            solve: Solve = partial(solve_task, prepared=prepared, options=options, workers=workers)
            if self._guess is None and options.coarser_start:
                found = solve_from_start(
                    task,
                    options,
                    solve,
                    volume_goal=volume_goal,
                    stop=stop,
                    progress=progress,
                    coarser_progress=self._coarser_progress,
                )
            else:
                found = solve(task, stop=stop, progress=progress)
        self._guess = found.positions
        return found


def solver_threads(options: Options, n: int) -> int:
    """Return the number of threads that share an iteration on a proxy of n vertices.

    One thread iterates if samplings share the CPUs, or the proxy is small.
    """
    return (options.workers or available_cpus()) if options.samplings == 1 and n >= SMALL else 1


def solve_from_start(
    task: DeformationTask,
    options: Options,
    solve: Solve,
    *,
    volume_goal: float,
    stop: Stop,
    progress: Progress,
    coarser_progress: Progress,
) -> Solution:
    """Solve a proxy from a coarser proxy, or from the lower of two starts.

    Parameters
    ----------
    task : DeformationTask
        Of the proxy, without a guess. Small proxies, below :data:`SMALLEST` vertices, proxies with many
        handles, and thin proxies whose topology a coarser proxy cannot keep have no coarser proxy.
    options : Options
    solve : Solve
        The solver of the proxy.
    volume_goal : float
        Volume of N', as a multiple of the volume of N.
    stop : Stop
    progress, coarser_progress : Progress
        Of the solves on the proxy and on the coarser proxy.
    """
    if (rough := coarser_start(task, options, stop, coarser_progress)) is not None:
        near = replace(task, guess=rough.positions)
        found = solve(near, stop=stop, progress=progress, softened=True)
        return replace(found, coarser_iterations=rough.iterations)
    found = lowest(task, options, solve, volume_goal=volume_goal, stop=stop, progress=progress)
    return replace(found, coarser_iterations=0.0)


def coarser_start(task: DeformationTask, options: Options, stop: Stop, progress: Progress) -> Solution | None:
    """Deform N through a coarser proxy, at its own volume; return None where that does not help."""
    mesh, handles = task.mesh, task.handles
    size = max(mesh.n // RATIO, ROOM * len(handles))
    if mesh.n < SMALLEST or size > mesh.n // ROOM:
        return None
    try:
        mesh.require_one_component()
        vertices = proxy_vertices(size, mesh.n, len(handles), coarser=ROOM)
        regions = HandleRegions(mesh, handles, vertices=vertices, graph=vertex_graph(mesh))
        sampling, place = sample_with_handles(mesh, regions, (options.seed, 0))
        coarser = DeformationTask("coarser", proxy_mesh(mesh, sampling), place(handles))
        frames = frame_maker("blended")
        with (
            beside(partial(bind_proxy, mesh, sampling, frames=frames), size=mesh.n) as binding,
            beside(partial(prepare, coarser, options), size=coarser.mesh.n) as prepared,
        ):
            workers = solver_threads(options, coarser.mesh.n)
            solve: Solve = partial(solve_task, prepared=prepared, options=options, workers=workers)
            rough = lowest(
                coarser,
                options,
                solve,
                volume_goal=1.0,
                stop=replace(stop, tolerance=ROUGH * stop.tolerance),
                progress=progress,
            )
            V, _ = binding.result().carry(rough.positions, rotations=rough.rotations)
        V = regions.on_targets(V, handles)
    except InputError as error:
        log.info("solved without a coarser proxy of %d vertices: %s", size, error)
        return None
    return replace(rough, positions=V)


def lowest(
    task: DeformationTask,
    options: Options,
    solve: Solve,
    *,
    volume_goal: float,
    stop: Stop,
    progress: Progress,
) -> Solution:
    """Solve from the minimum of the guide energy and from the plain start, and return the better solution.

    Without a guide energy, solve from the plain start. An error of one solve, such as an interrupt, ends the
    other at its next report of progress.
    """
    if not options.guide_attachment:
        return solve(task, stop=stop, progress=progress)
    guide = replace(
        options,
        attachment=options.guide_attachment,
        stiffness=1.0,
        area=min(options.area, GUIDE_AREA),
    )
    failed, n = Event(), task.mesh.n
    report = partial(_report_unless, failed, progress)
    with beside(partial(solve, task, stop=stop, progress=report), size=n) as started:
        try:
            at_guide = solve_task(
                task,
                prepared=Later(partial(prepare, task, guide, volume_goal=volume_goal)),
                options=guide,
                workers=solver_threads(options, n),
                stop=stop,
                progress=progress,
            )
            guided = solve(replace(task, guess=at_guide.positions), stop=stop, progress=progress)
            plain = started.result()
        except BaseException:
            failed.set()
            raise
    assert plain.energy is not None and guided.energy is not None
    return plain if plain.energy < CLEARLY_LOWER * guided.energy else guided


def _report_unless(
    failed: Event, progress: Progress, stage: str, done: int, total: int, note: str = ""
) -> None:
    if failed.is_set():
        raise CancelledError
    progress(stage, done, total, note)
