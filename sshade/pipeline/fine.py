"""Beyond the paper: constrained, softening proxies carried back with blended frames, and a polish.

`sshade_fast` is one proxy: its volume and its area held, its triangles softening
(:mod:`sshade.solver.strain_softening`), its motion blended over each triangle
(:mod:`sshade.carry.blended`). `sshade_fine` goes on from there with a few accelerated
iterations of the same energy at full resolution, and leads apart what crosses in
the end (:mod:`sshade.contact.separate`).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from time import perf_counter
from typing import Any, Unpack

import numpy as np

from sshade.carry.frames import FrameKind
from sshade.contact.separate import MARGIN, separate
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.pipeline.multilevel import multilevel
from sshade.sampling.fronts import farthest_point_sampling
from sshade.solver.local_global import LocalGlobal, Solution, local_global
from sshade.solver.options import SolverOptions, complete, energy_options
from sshade.solver.substitution import Factors, divide, substitute_together
from sshade.task import DeformationResult, DeformationTask, Progress, silent
from sshade.threads import ThreadTeam, available_cpus, number_of_workers

#: Stiffness of strongly strained triangles, and the strain about which they soften.
STIFFNESS, STRAIN = 0.08, 0.0125
#: Times that crossings are led apart and the constraints restored.
PASSES = 5


def sshade_fast(
    task: DeformationTask,
    *,
    vertices: int = 6000,
    samplings: int = 1,
    frames: FrameKind = "blended",
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[SolverOptions],
) -> DeformationResult:
    """SShaDe with one constrained proxy and blended frames.

    Parameters
    ----------
    task : DeformationTask
        As for :func:`sshade.deform`.
    vertices, samplings, frames, workers
        See :func:`sshade.deform`.
    **options
        Of the proxy's energy, the spokes and rims, and its iteration; see
        :class:`sshade.solver.options.SolverOptions`. By default volume and area are exact (inf),
        stiffness and strain :data:`STIFFNESS` and :data:`STRAIN`, and the start is "rigid".
        Large proxies begin with a coarser one's result: see :mod:`sshade.pipeline.multilevel`.
    seed : int
        Of the sampling.
    progress : Progress

    Returns
    -------
    DeformationResult
        As of :func:`sshade.deform`. Volume and area are held on the proxy: those
        of the mesh come out within what the proxy's details add, about 0.05 %
        at a vertex in four.

    Raises
    ------
    InputError
        Those of :func:`sshade.deform` and :func:`sshade.solver.local_global.local_global`.
    """
    solver = complete(options, volume=inf, area=inf, stiffness=STIFFNESS, strain=STRAIN, start="rigid")
    tolerance = solver.pop("tolerance")
    return deform(
        task,
        vertices=vertices,
        samplings=samplings,
        coarse=partial(multilevel, coarse=partial(local_global, **solver), tolerance=tolerance),
        frames=frames,
        workers=workers,
        seed=seed,
        progress=progress,
    )


def sshade_fine(
    task: DeformationTask,
    *,
    vertices: int = 6000,
    polish_iterations: int = 50,
    polish_seconds: float | None = None,
    contact: bool = True,
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[SolverOptions],
) -> DeformationResult:
    """`sshade_fast`, polished: accelerated iterations of the same energy at full resolution.

    A proxy gets the low frequencies right, which take iterations at full
    resolution the longest; these in turn remove the proxy's traces in a few.
    The factorisation at full resolution does not depend on the proxy, and is
    made meanwhile in a thread of its own.

    Parameters
    ----------
    task : DeformationTask
    vertices : int
        Of the proxy; see :func:`sshade_fast`.
    polish_iterations : int
        Iterations at full resolution, at most.
    polish_seconds : float, optional
        Another limit to them; the result then depends on the machine.
    contact : bool
        Whether to lead apart what crosses in the end, and to unfold what is flipped, unless
        it was so at rest; see :mod:`sshade.contact.separate`.
    workers : int, optional
        Threads at full resolution; by default one for each CPU. No influence on the result.
    seed : int
        Of the sampling.
    progress : Progress
    **options
        As of :func:`sshade_fast`: `max_iterations` and `start` of the proxy, the others of both
        resolutions. The area has the weight 1 by default, which leaves it some half a percent;
        for that, edges and angles change a twentieth less than with an exact one.

    Returns
    -------
    DeformationResult
        `iterations` and `converged` are of the polish. Handles are on their
        targets, and exact constraints hold to 1e-6. ``seconds``: ``precompute``
        overlaps with ``proxy``, ``wait`` is what it took longer. ``extra`` as of
        :func:`sshade.solver.local_global.local_global`, the proxy's iterations, and the faces
        that cross others or are flipped after the polish and in the end.

    Raises
    ------
    InputError
        Those of :func:`sshade_fast`.
    """
    begin = perf_counter()
    workers = number_of_workers(workers, default=available_cpus())
    solver_options = complete(
        options, volume=inf, area=1.0, stiffness=STIFFNESS, strain=STRAIN, start="rigid"
    )
    with ThreadPoolExecutor(max_workers=1) as pool:
        bound = pool.submit(_bind, task)
        proxy = sshade_fast(task, vertices=vertices, seed=seed, progress=progress, **solver_options)
        arrived = perf_counter()
        solver, precompute = bound.result()
    ready = perf_counter()
    energy: dict[str, Any] = {**energy_options(solver_options), "workers": workers}
    solution = solver.solve(
        task.handles.target,
        start=proxy.vertices,
        tolerance=solver_options["tolerance"],
        max_iterations=polish_iterations,
        max_seconds=inf if polish_seconds is None else polish_seconds,
        progress=lambda _, done, total, note="": progress("polish", done, total, note),
        **energy,
    )
    polished = perf_counter()
    facts = {"proxy_iterations": proxy.iterations}
    if contact:
        solution, tangled = _lead_apart(solver, solution, energy, progress=progress)
        facts |= tangled
    seconds = {
        "proxy": arrived - begin,
        "precompute": precompute,
        "wait": ready - arrived,
        "polish": polished - ready,
        "contact": perf_counter() - polished,
    }
    return DeformationResult(
        vertices=solution.positions,
        iterations=solution.iterations,
        converged=solution.converged,
        seconds=seconds,
        extra={**solution.facts(), **facts, "proxy_vertices": proxy.extra["proxy_vertices"]},
    )


def prepare() -> None:
    """Compile the kernels that :func:`sshade_fine` needs for large meshes or crossing surfaces only.

    For those who time it, and run it on something small first.
    """
    chain = Factors(np.array([0, 1, 2, 2]), np.array([1, 2], dtype=np.int32), np.ones(2), np.ones(3))
    _, factors, branches = divide(chain, parts=2)
    with ThreadTeam(1) as team:
        substitute_together(factors, branches, np.zeros((3, 3)), team=team)
    V = np.concatenate([np.eye(3), -np.eye(3)])
    F = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    octahedron = Mesh(V, np.array(F))
    farthest_point_sampling(vertex_graph(octahedron), 2, first=np.array([0])).insert(np.array([1]))
    V[2, 2] = -2.0
    separate(octahedron, V, np.array([5]), rounds=2)


def _lead_apart(
    solver: LocalGlobal, solution: Solution, energy: dict[str, Any], *, progress: Progress
) -> tuple[Solution, dict[str, int]]:
    """The solution without crossings and flips, and how many faces there were before and still are.

    What is led apart loses the volume of the overlap; with that given back to the
    whole, some of it may cross again.
    """
    local = {name: energy[name] for name in ("stiffness", "strain", "workers")}
    exact = {name: energy[name] for name in ("volume", "area", "workers")}
    positions, counts, met = solution.positions, [], None
    best = positions
    for attempt in range(1, PASSES + 1):
        parted = separate(
            solver.mesh,
            positions,
            solver.index,
            met=met,
            margin=attempt * MARGIN,
            progress=progress,
            **local,
        )
        met = parted.met
        counts.append(parted.before)
        if parted.before <= min(counts):
            best = positions
        # Handles that force parts through each other leave most of the crossings.
        if parted.before == 0 or parted.after > 0.5 * parted.before:
            break
        positions = solver.project(parted.positions, **exact)
    tangled = {"tangled_polished": counts[0], "tangled": min(counts)}
    if best is solution.positions:
        return solution, tangled
    after = solver.solve(
        best[solver.index], start=best, rotations=solution.rotations, max_iterations=0, **energy
    )
    names = "iterations", "residual", "residual_curve", "converged", "rejected", "energy_initial"
    return after._replace(**{name: getattr(solution, name) for name in names}), tangled


def _bind(task: DeformationTask) -> tuple[LocalGlobal, float]:
    begin = perf_counter()
    return LocalGlobal(task.mesh, task.handles.index), perf_counter() - begin
