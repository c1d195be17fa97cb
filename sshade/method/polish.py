"""Polish the proxy's result: accelerated iterations of the same energy at full resolution."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from time import perf_counter

import numpy as np

from sshade.core.progress import Progress, renamed
from sshade.core.threads import Pending, available_cpus
from sshade.mesh.adjacency import vertex_graph
from sshade.problem.options import Options, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.fronts import Fronts
from sshade.regions.handle_regions import HandleRegions, has_regions
from sshade.solver.aim import Aim
from sshade.solver.local_global import BoundSystem, bind_system, project, solve
from sshade.solver.quasi_newton import WINDOW_OF_POLISH
from sshade.solver.solution import Solution
from sshade.solver.system import System, give_back

#: Stiffness with which the vertices of a cell are pulled together. Below 4, walls wrinkle where they are
#: compressed.
PULL = 4.0


def set_up(task: DeformationTask, options: Options) -> BoundSystem:
    """Set up the solver of a polish, beside the proxies."""
    give_back()  # frees memory of earlier work before the stage that needs most
    goal = options.volume_goal or 1.0
    return bind_system(task, options, volume_goal=goal, factorised=False, exact_steps=0)


def polished(
    task: DeformationTask,
    options: Options,
    proxy: DeformationResult,
    *,
    ready: Pending[BoundSystem],
    begin: float,
    progress: Progress,
) -> DeformationResult:
    """Solve at full resolution from the result of a proxy.

    A proxy finds the low frequencies of the motion, for which iterations at full resolution take longest.
    A few iterations at full resolution remove the traces of the proxy. Their global steps are V-cycles
    (:mod:`sshade.solver.multigrid`), so that time and memory grow like the mesh. A surface hardly resists
    bending, and would leave the pose: a head would sway around a nose that is fixed. Where joints are round,
    every vertex is therefore pulled softly to its place after the proxy. The pull is as strong as the surface
    over half the distance between samples, weaker below and stronger above.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    proxy : DeformationResult
    ready : Pending of BoundSystem
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
    workers = options.workers or available_cpus()
    turns = _rotations_near_handles(task, samples=proxy.facts.samples)
    system, aim = prepared.system, replace(prepared.aim, prescribed=turns)
    if options.joints:
        system, aim = _held_by(task, proxy, system, aim)
    start = [proxy.vertices]
    proxy = replace(proxy, vertices=np.empty((0, 3)))
    give_back()
    solution = solve(
        system,
        aim,
        options,
        start=start.pop(),  # so that the solver can free it
        stop=Stop(options.tolerance, options.polish_iterations),
        window=WINDOW_OF_POLISH,
        workers=workers,
        progress=renamed(progress, "polish"),
    )
    if has_regions(task.mesh, task.handles.index, options):
        progress("regions", 0, 1)
        graph, samples = vertex_graph(task.mesh), proxy.facts.samples
        regions = HandleRegions(task.mesh, task.handles, vertices=samples, graph=graph)
        turned = regions.on_targets(solution.positions, task.handles)
        if solution.constraints.volume_constraint == "yielding":
            solution = replace(solution, positions=turned)
        else:
            solution = _solution_at(system, solution, turned, aim, options, workers)
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
        volume_error=solution.constraints.volume_error,
        area_error=solution.constraints.area_error,
        volume_pressure=solution.constraints.volume_pressure,
        area_pressure=solution.constraints.area_pressure,
        volume_constraint=solution.constraints.volume_constraint,
        area_constraint=solution.constraints.area_constraint,
    )
    converged = solution.converged or None
    return DeformationResult(solution.positions, solution.iterations, converged, seconds, facts=facts)


def _held_by(task: DeformationTask, proxy: DeformationResult, system: System, aim: Aim) -> tuple[System, Aim]:
    """Pull every vertex to its place after the proxy, in place of the attachment.

    The vertices of a cell have one stiffness together, so that the pull and the surface balance over half the
    distance between samples.
    """
    handles, mesh = task.handles, task.mesh
    stiffness = PULL * proxy.facts.samples * mesh.vertex_areas / mesh.area
    stiffness[handles.index] = 0.0
    own = np.flatnonzero(stiffness)
    index, stiffness = (
        np.concatenate([handles.index, own]),
        np.concatenate([handles.stiffness, stiffness[own]]),
    )
    targets = np.concatenate([handles.target, proxy.vertices[own]])
    # An exact constraint works against the pull, so that its pressure says nothing of the handles.
    states = proxy.facts.volume_constraint, proxy.facts.area_constraint
    yields = ["yielding" in (state or "") for state in states]
    volume, area = (most if one else inf for most, one in zip(aim.pressure, yields, strict=True))
    aim = replace(aim, targets=targets, pressure=(volume, area))
    return system.with_handles(index, stiffness=stiffness), aim


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
    system: System, solution: Solution, V: np.ndarray, aim: Aim, options: Options, workers: int
) -> Solution:
    """A solution at other positions, projected onto the constraints; the record of the iteration stays."""
    V = project(system, V, options, volume_goal=aim.volume_goal, workers=workers)
    after = solve(
        system,
        aim,
        options,
        start=V,
        rotations=solution.rotations,
        stop=Stop(options.tolerance, 0),
        workers=workers,
    )
    return replace(
        after,
        iterations=solution.iterations,
        residual=solution.residual,
        residual_curve=solution.residual_curve,
        converged=solution.converged,
        rejected=solution.rejected,
    )
