"""Polish the proxy's result: accelerated iterations of the same energy at full resolution."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from sshade.core.progress import Progress, renamed
from sshade.core.threads import available_cpus
from sshade.mesh.adjacency import vertex_graph
from sshade.method.regions import HandleRegions, has_regions
from sshade.problem.options import ENERGY, Options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.fronts import Fronts
from sshade.solver.local_global import LocalGlobal, prepare
from sshade.solver.run import Aim, Solution
from sshade.solver.system import give_back

#: Number of steps that quasi-Newton iterations remember. A larger number takes more memory, and gave no
#: better results on six bodies.
WINDOW = 4


class Polish:
    """A solve at full resolution from the result of a proxy.

    A proxy finds the low frequencies of the motion, for which iterations at full resolution take longest.
    A few iterations at full resolution remove the traces of the proxy. Their global steps are V-cycles
    (:mod:`sshade.solver.multigrid`), so that time and memory grow like the mesh. A thread sets the solver up
    inside of a ``with`` block, beside the proxy's solve.

    Parameters
    ----------
    task : DeformationTask
    options : Options
    progress : Progress
    """

    def __init__(self, task: DeformationTask, options: Options, progress: Progress) -> None:
        self._task, self._options, self._progress = task, options, progress
        self._begin = perf_counter()

    def __enter__(self) -> Polish:
        goal = self._options.volume_goal or 1.0
        set_up = partial(prepare, volume_goal=goal, factorised=False, exact_steps=0)
        give_back()  # frees memory of earlier work before the stage that needs most
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._ready = self._pool.submit(set_up, self._task, self._options)
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown()

    def solve(self, proxy: DeformationResult) -> DeformationResult:
        """Solve from the result of a proxy.

        Returns
        -------
        DeformationResult
            `iterations` counts the polish alone. `converged` is None where it used up its iterations, as
            usual. Handles are on their targets, and exact constraints hold to 1e-6. ``seconds``:
            ``precompute`` overlaps with ``proxy``; ``wait`` is the time that it took longer.
        """
        task, options, arrived = self._task, self._options, perf_counter()
        self._progress("polish", 0, options.polish_iterations, "preparing")
        prepared = self._ready.result()
        ready = perf_counter()
        energy = {**options.subset(ENERGY), "workers": options.workers or available_cpus()}
        turns = _rotations_near_handles(task, samples=proxy.facts.samples)
        aim = replace(prepared.aim, prescribed=turns)
        start = [proxy.vertices]
        proxy = replace(proxy, vertices=np.empty((0, 3)))
        give_back()
        solution = prepared.solver.solve(
            **vars(aim),
            start=start.pop(),  # so that the solver can free it
            tolerance=options.tolerance,
            max_iterations=options.polish_iterations,
            window=WINDOW,
            progress=renamed(self._progress, "polish"),
            **energy,
        )
        if has_regions(task.mesh, task.handles.index, options):
            self._progress("regions", 0, 1)
            graph, samples = vertex_graph(task.mesh), proxy.facts.samples
            regions = HandleRegions(task.mesh, task.handles, vertices=samples, graph=graph)
            turned = regions.on_targets(solution.positions, task.handles)
            solution = _solution_at(prepared.solver, solution, turned, aim, energy)
            self._progress("regions", 1, 1)
        seconds = {
            "proxy": arrived - self._begin,
            "precompute": prepared.seconds,
            "wait": ready - arrived,
            "polish": perf_counter() - ready,
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
    after = solver.solve(**vars(aim), start=V, rotations=solution.rotations, max_iterations=0, **energy)
    kept = "iterations", "residual", "residual_curve", "converged", "rejected"
    return after._replace(**{name: getattr(solution, name) for name in kept})
