"""Beyond the paper: `sshade_fast`, polished at full resolution, with its self-intersections resolved."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import inf
from time import perf_counter
from typing import Any, Unpack

from sshade.contact.separate import MARGIN, separate
from sshade.pipeline.fast import STIFFNESS, STRAIN, sshade_fast
from sshade.solver.local_global import LocalGlobal, Solution
from sshade.solver.options import SolverOptions, complete, energy_options
from sshade.task import DeformationResult, DeformationTask, Progress, silent
from sshade.threads import available_cpus, number_of_workers

#: Times that intersections are resolved and the constraints restored, at most.
PASSES = 5


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
        Of the proxy; see :func:`sshade.sshade_fast`.
    polish_iterations : int
        Iterations at full resolution, at most.
    polish_seconds : float, optional
        Another limit to them; the result then depends on the machine.
    contact : bool
        Whether to resolve self-intersections and inverted faces in the end that were not there at
        rest; see :mod:`sshade.contact.separate`.
    workers : int, optional
        Threads at full resolution; by default one for each CPU. No influence on the result.
    seed : int
        Of the sampling.
    progress : Progress
    **options
        As of :func:`sshade.sshade_fast`: `max_iterations` and `start` of the proxy, the others of both
        resolutions. The area has the weight 1 by default, which leaves it some half a percent;
        for that, edges and angles change a twentieth less than with an exact one.

    Returns
    -------
    DeformationResult
        `iterations` are of the polish. `converged` is true where its residual fell below the
        tolerance, None where it used up the iterations or seconds that it was given, its usual
        end. Handles are on their targets, and exact constraints hold to 1e-6. ``seconds``: ``precompute``
        overlaps with ``proxy``, ``wait`` is what it took longer. ``extra`` as of
        :func:`sshade.solver.local_global.local_global`, the proxy's iterations, and the numbers
        of faces that are ``intersecting_or_inverted_polished``, after the polish, and
        ``intersecting_or_inverted`` in the end.

    Raises
    ------
    InputError
        Those of :func:`sshade.sshade_fast`.
    """
    workers = number_of_workers(workers, default=available_cpus())
    # What the proxy will refuse, before the factorisation begins that its error would wait for.
    task.mesh.require_manifold()
    task.mesh.require_one_component()
    begin = perf_counter()
    own = complete(options, volume=inf, area=1.0, stiffness=STIFFNESS, strain=STRAIN, start="rigid")
    with ThreadPoolExecutor(max_workers=1) as pool:
        bound = pool.submit(_bind, task)
        proxy = sshade_fast(task, vertices=vertices, seed=seed, progress=progress, **own)
        arrived = perf_counter()
        solver, precompute = bound.result()
    ready = perf_counter()
    energy: dict[str, Any] = {**energy_options(own), "workers": workers}
    solution = solver.solve(
        task.handles.target,
        start=proxy.vertices,
        tolerance=own["tolerance"],
        max_iterations=polish_iterations,
        max_seconds=inf if polish_seconds is None else polish_seconds,
        progress=lambda _, done, total, note="": progress("polish", done, total, note),
        **energy,
    )
    polished = perf_counter()
    facts = {"proxy_iterations": proxy.iterations, "proxy_vertices": proxy.extra["proxy_vertices"]}
    if contact:
        solution, counts = _resolve_intersections(solver, solution, energy, progress=progress)
        facts |= counts
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
        converged=solution.converged or None,
        seconds=seconds,
        extra={**solution.facts(), **facts},
    )


def _bind(task: DeformationTask) -> tuple[LocalGlobal, float]:
    begin = perf_counter()
    return LocalGlobal(task.mesh, task.handles.index), perf_counter() - begin


def _resolve_intersections(
    solver: LocalGlobal, solution: Solution, energy: dict[str, Any], *, progress: Progress
) -> tuple[Solution, dict[str, int]]:
    """A solution with the fewest intersecting or inverted faces, and their numbers before and after.

    Separating two parts of the surface takes away the volume of their overlap; projecting the
    whole onto the constraints again can bring back some of it.
    """
    patch = {name: energy[name] for name in ("stiffness", "strain", "workers")}
    constraints = {name: energy[name] for name in ("volume", "area", "workers")}
    positions, counts, penetrating = solution.positions, [], None
    best = positions
    for attempt in range(1, PASSES + 1):
        separated = separate(
            solver.mesh,
            positions,
            solver.index,
            penetrating=penetrating,
            margin=attempt * MARGIN,
            progress=progress,
            **patch,
        )
        penetrating = separated.penetrating
        counts.append(separated.before)
        if separated.before <= min(counts):
            best = positions
        # Handles that force parts through each other leave most of the intersections.
        if separated.before == 0 or separated.after > 0.5 * separated.before:
            break
        positions = solver.project(separated.positions, **constraints)
    facts = {"intersecting_or_inverted_polished": counts[0], "intersecting_or_inverted": min(counts)}
    if best is solution.positions:
        return solution, facts
    after = solver.solve(
        best[solver.index], start=best, rotations=solution.rotations, max_iterations=0, **energy
    )
    names = "iterations", "residual", "residual_curve", "converged", "rejected", "energy_initial"
    return after._replace(**{name: getattr(solution, name) for name in names}), facts
