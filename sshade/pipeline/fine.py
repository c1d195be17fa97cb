"""Beyond the paper: `sshade_fast`, polished at full resolution."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf
from time import perf_counter
from typing import Any

import numpy as np

from sshade.memory import give_back
from sshade.mesh.adjacency import vertex_graph
from sshade.options import ENERGY, SOLVER, takes_options
from sshade.pipeline.components import each_component
from sshade.pipeline.fast import PROXY, REGION_STIFFNESS, STIFFNESS, VERTICES, completed, sshade_fast
from sshade.pipeline.regions import OF_REGIONS, HandleRegions, all_on_targets, has_regions
from sshade.progress import Progress, silent
from sshade.sampling.fronts import Fronts
from sshade.solver.attachment import Attachment
from sshade.solver.local_global import LocalGlobal
from sshade.solver.solution import Solution
from sshade.task import DeformationResult, DeformationTask
from sshade.threads import available_cpus, number_of_workers

#: By default; less bound to parts than the proxy alone, to stretch less in the end, and with a limit to
#: strain, as fine triangles crease where those of a proxy cannot.
POLISH = PROXY | dict[str, Any](area=1.0, attachment=0.01, stiffness=0.03, strain_limit=0.25)
#: Where handles are regions strain gathers at their edges, and a limit spreads it from there.
REGIONS = POLISH | OF_REGIONS | dict[str, Any](stiffness=REGION_STIFFNESS, strain_limit=inf)
#: How strongly handle groups pull their parts along on the proxy: half of what they do without a polish, as
#: nearest to the truth lie basins where the volume costs more stretch.
PROXY_ATTACHMENT = 0.05
#: Steps that quasi-Newton ones remember at full resolution: with more a polish is no better (six bodies), and
#: takes more memory.
WINDOW = 4


@takes_options(SOLVER)
@each_component(vertices=VERTICES)
def sshade_fine(
    task: DeformationTask,
    *,
    vertices: int = VERTICES,
    proxy_attachment: float = PROXY_ATTACHMENT,
    proxy_stiffness: float = STIFFNESS,
    polish_iterations: int = 50,
    polish_seconds: float | None = None,
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """`sshade_fast`, polished: accelerated iterations of the same energy at full resolution.

    A proxy gets the low frequencies right, which take iterations at full
    resolution the longest; these in turn remove the proxy's traces in a few. Their
    global steps are V-cycles (:mod:`sshade.solver.multigrid`), so that time and memory
    grow like the mesh. What does not depend on the proxy is set up meanwhile in a thread of its own.

    Parameters
    ----------
    task : DeformationTask
    vertices : int
        Of the proxy; see :class:`sshade.pipeline.proxies.ProxyOptions`.
    proxy_attachment, proxy_stiffness : float
        `attachment` and `stiffness` of the proxy.
    polish_iterations : int
        Iterations at full resolution, at most.
    polish_seconds : float, optional
        Another limit to them; the result then depends on the machine.
    workers : int, optional
        Threads at full resolution; by default one for each CPU. No influence on the result.
    seed : int
        Of the sampling.
    progress : Progress
    **options
        As of :func:`sshade.sshade_fast`: `max_iterations`, `start` and `bending` of the proxy, `attachment`,
        `stiffness` and `strain_limit` of the polish, the others of both. By default :data:`POLISH`: the
        weight of the area leaves it some half a percent; for that, edges and angles change a twentieth less than
        with an exact one. With handle regions :data:`REGIONS`.

    Returns
    -------
    DeformationResult
        `iterations` are of the polish. `converged` is true where its residual fell below the
        tolerance, None where it used up the iterations or seconds that it was given, its usual
        end. Handles are on their targets, and exact constraints hold to 1e-6. ``seconds``: ``precompute``
        overlaps with ``proxy``, ``wait`` is what it took longer. ``extra`` as of
        :func:`sshade.solver.local_global.local_global`, the proxy's iterations and size, and ``samples``
        and ``faces_without_area`` as of :func:`sshade.sshade`.

    Raises
    ------
    InputError
        Those of :func:`sshade.sshade_fast`.
    """
    workers = number_of_workers(workers, default=available_cpus())
    if task.handles.hard.sum() == task.mesh.n:
        return all_on_targets(task)
    begin = perf_counter()
    give_back()  # what others left, before this needs the most
    regional = has_regions(task, vertices)
    own = completed(options, REGIONS if regional else POLISH)
    with ThreadPoolExecutor(max_workers=1) as pool:
        bound = pool.submit(_bind, task, own["attachment"])
        of_proxy: Any = own | {"attachment": proxy_attachment, "stiffness": proxy_stiffness}
        of_proxy["strain_limit"] = inf
        proxy = sshade_fast(task, vertices=vertices, seed=seed, progress=progress, **of_proxy)
        arrived = perf_counter()
        solver, targets, precompute = bound.result()
    ready = perf_counter()
    energy: dict[str, Any] = {**{name: own[name] for name in ENERGY}, "workers": workers}
    energy["prescribed"] = _around(task, samples=proxy.extra["samples"])
    start = [proxy.vertices]
    proxy = replace(proxy, vertices=np.empty((0, 3)))
    give_back()
    solution = solver.solve(
        targets,
        start=start.pop(),  # it lets go of it
        tolerance=own["tolerance"],
        max_iterations=polish_iterations,
        window=WINDOW,
        max_seconds=inf if polish_seconds is None else polish_seconds,
        progress=lambda _, done, total, note="": progress("polish", done, total, note),
        **energy,
    )
    shared = ("samples", "proxy_vertices", "faces_without_area", "proxy_basin")
    facts: dict[str, Any] = {"proxy_iterations": proxy.iterations}
    facts |= {name: proxy.extra[name] for name in shared if name in proxy.extra}
    if regional:
        graph = vertex_graph(task.mesh)
        regions = HandleRegions(task.mesh, task.handles, vertices=facts["samples"], graph=graph)
        turned = regions.on_targets(solution.positions, task.handles)
        solution = _moved(solver, solution, turned, targets, energy)
    seconds = {
        "proxy": arrived - begin,
        "precompute": precompute,
        "wait": ready - arrived,
        "polish": perf_counter() - ready,
    }
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged or None,
        seconds=seconds,
        extra={**solution.facts(), **facts},
    )


def _bind(task: DeformationTask, parts: float) -> tuple[LocalGlobal, np.ndarray, float]:
    """The solver at full resolution, targets of what it holds and pulls, and the time it took."""
    begin = perf_counter()
    attachment = Attachment(task.mesh, task.handles, parts, fold=True)
    solver = LocalGlobal(task.mesh, attachment.vertex, stiffness=attachment.stiffness, multigrid=True)
    targets, _ = attachment.pulls(task.handles.target, task.handles.rotation)
    return solver, targets, perf_counter() - begin


def _around(task: DeformationTask, *, samples: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The rotations of handles, known within the reach of a sample: the radius of a disc of its area.

    A proxy's vertex turns as much of the surface as is its own. At full resolution the handle's vertex
    alone would turn next to nothing.
    """
    known = task.handles.prescribed_rotations
    if known is None:
        return None
    vertex, R = known
    fronts = Fronts(vertex_graph(task.mesh), vertex)
    near = np.flatnonzero(fronts.distance <= np.sqrt(task.mesh.area / (np.pi * samples)))
    return near, R[fronts.cell[near]]


def _moved(
    solver: LocalGlobal, solution: Solution, V: np.ndarray, targets: np.ndarray, energy: dict[str, Any]
) -> Solution:
    """A solution at other positions, where the constraints hold again; how the iteration went stays."""
    V = solver.project(V, **{name: energy[name] for name in ("volume", "area", "workers")})
    after = solver.solve(targets, start=V, rotations=solution.rotations, max_iterations=0, **energy)
    names = "iterations", "residual", "residual_curve", "converged", "rejected", "energy_initial"
    return after._replace(**{name: getattr(solution, name) for name in names})
