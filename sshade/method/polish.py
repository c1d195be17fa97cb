"""Polish the proxy's result: accelerated iterations of the same energy at full resolution."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from sshade.core.progress import Progress, renamed
from sshade.core.threads import Pending, available_cpus
from sshade.mesh.adjacency import vertex_graph
from sshade.method.regions import HandleRegions, has_regions
from sshade.problem.options import ENERGY, Options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.fronts import Fronts
from sshade.solver.local_global import LocalGlobal, Prepared, prepare
from sshade.solver.quasi_newton import WINDOW_OF_POLISH
from sshade.solver.run import Aim, Solution
from sshade.solver.system import give_back


def set_up(task: DeformationTask, options: Options) -> Prepared:
    """Set up the solver of a polish, beside the proxies."""
    give_back()  # frees memory of earlier work before the stage that needs most
    goal = options.volume_goal or 1.0
    return prepare(task, options, volume_goal=goal, factorised=False, exact_steps=0)


def polished(
    task: DeformationTask,
    options: Options,
    proxy: DeformationResult,
    *,
    ready: Pending[Prepared],
    begin: float,
    progress: Progress,
) -> DeformationResult:
    """Solve at full resolution from the result of a proxy.

    A proxy finds the low frequencies of the motion, for which iterations at full resolution take longest.
    A few iterations at full resolution remove the traces of the proxy. Their global steps are V-cycles
    (:mod:`sshade.solver.multigrid`), so that time and memory grow like the mesh.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    proxy : DeformationResult
    ready : Pending of Prepared
        Result of :func:`set_up`, now or later.
    begin : float
        When the proxies and the set-up began.
    progress : Progress

    Returns
    -------
    DeformationResult
        `iterations` counts the polish alone. `converged` is None where it used up its iterations, as usual.
        Handles are on their targets, and exact constraints hold to 1e-6. ``seconds``: ``precompute`` overlaps
        with ``proxy``; ``wait`` is the time that it took longer.
    """
    arrived = perf_counter()
    progress("polish", 0, options.polish_iterations, "preparing")
    prepared = ready.result()
    begun = perf_counter()
    energy = {**options.subset(ENERGY), "workers": options.workers or available_cpus()}
    turns = _rotations_near_handles(task, samples=proxy.facts.samples)
    aim = replace(prepared.aim, prescribed=turns)
    start = [proxy.vertices]
    proxy = replace(proxy, vertices=np.empty((0, 3)))
    give_back()
    solution = prepared.solver.solve(
        aim,
        start=start.pop(),  # so that the solver can free it
        tolerance=options.tolerance,
        max_iterations=options.polish_iterations,
        window=WINDOW_OF_POLISH,
        progress=renamed(progress, "polish"),
        **energy,
    )
    if has_regions(task.mesh, task.handles.index, options):
        progress("regions", 0, 1)
        graph, samples = vertex_graph(task.mesh), proxy.facts.samples
        regions = HandleRegions(task.mesh, task.handles, vertices=samples, graph=graph)
        turned = regions.on_targets(solution.positions, task.handles)
        solution = _solution_at(prepared.solver, solution, turned, aim, energy)
        progress("regions", 1, 1)
    seconds = {
        "proxy": arrived - begin,
        "precompute": prepared.seconds,
        "wait": begun - arrived,
        "polish": perf_counter() - begun,
    }
    facts = replace(
        proxy.facts,
        proxy_iterations=proxy.iterations,
        residual=solution.residual,
        energy=solution.energy,
        volume_error=solution.volume_error,
        area_error=solution.area_error,
        volume_constraint=solution.volume_constraint,
        area_constraint=solution.area_constraint,
    )
    converged = solution.converged or None
    return DeformationResult(solution.positions, solution.iterations, converged, seconds, facts=facts)


def _rotations_near_handles(task: DeformationTask, *, samples: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Prescribe the handles' rotations within the radius of a disc with a sample's area.

    On a proxy a vertex turns the surface of its cell. At full resolution the handle's vertex alone would turn
    next to nothing.
    """
    if (prescribed := task.handles.prescribed_rotations) is None:
        return None
    vertex, R = prescribed
    fronts = Fronts(vertex_graph(task.mesh), vertex)
    near = np.flatnonzero(fronts.distance <= np.sqrt(task.mesh.area / (np.pi * samples)))
    return near, R[fronts.cell[near]]


def _solution_at(
    solver: LocalGlobal, solution: Solution, V: np.ndarray, aim: Aim, energy: dict[str, Any]
) -> Solution:
    """A solution at other positions, projected onto the constraints; the record of the iteration stays."""
    exact = {name: energy[name] for name in ("volume", "area", "workers")}
    V = solver.project(V, volume_goal=aim.volume_goal, **exact)
    after = solver.solve(aim, start=V, rotations=solution.rotations, max_iterations=0, **energy)
    kept = "iterations", "residual", "residual_curve", "converged", "rejected"
    return after._replace(**{name: getattr(solution, name) for name in kept})
