"""SShaDe from end to end: sample, project, deform the proxy, carry the mesh along, average.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations", algorithm 1.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple, Unpack

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.carry.projection import Projector, project_to_fans
from sshade.pipeline.components import each_component
from sshade.pipeline.proxies import FACTS, VERTICES, Proxies, ProxyOptions
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.progress import Progress, silent
from sshade.sampling.proxy import Sampling, proxy_mesh
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask, Handles, Method
from sshade.threads import ThreadTeam

#: Share of the volume that proxies may miss before they are deformed again, and how often they are.
VOLUME_ERROR, VOLUME_ROUNDS = 1e-3, 3

#: Samples a task's mesh and gives the proxy its handles: of (task, regions, seed).
Sampler = Callable[[DeformationTask, HandleRegions, tuple[int, int]], tuple[Sampling, Handles]]


def sample_with_handles(
    task: DeformationTask, regions: HandleRegions, seed: tuple[int, int]
) -> tuple[Sampling, Handles]:
    """Sample M with its handle vertices first: they are vertices of N, and its handles.

    Parameters
    ----------
    task : DeformationTask
    regions : HandleRegions
        Of the task's handles.
    seed : (int, int)
    """
    sampling, number = regions.sample(seed)
    on = np.flatnonzero(number >= 0)
    return sampling, task.handles.sampled(number[on], on, task.mesh.V)


@each_component(vertices=VERTICES)
def sshade(
    task: DeformationTask,
    *,
    coarse: Method | None = None,
    warm_start: bool = False,
    keep_volume: bool = False,
    sample: Sampler = sample_with_handles,
    projection: Projector = project_to_fans,
    progress: Progress = silent,
    **options: Unpack[ProxyOptions],
) -> DeformationResult:
    """SShaDe: deform k proxies of the mesh, carry the mesh along with local frames, and average.

    Parameters
    ----------
    task : DeformationTask
        Its mesh may have a boundary. One that is not manifold, not oriented or of several components is
        deformed component by component: see :func:`sshade.pipeline.components.each_component`.
    coarse : Method, optional
        Deforms the proxy N; by default :func:`sshade.solver.local_global.local_global`,
        accelerated spokes-and-rims ARAP. Blended frames take the rotations of N's vertices
        from it where its ``extra`` has them.
    warm_start : bool
        Solve the later proxies from the first one's M' instead of from the coarse method's
        own start: fewer iterations, and all in one basin.
    keep_volume : bool
        Make up for the volume that the proxies miss where handles are regions: by another one of
        theirs, for which `coarse` takes the keyword ``volume_goal``, and then by
        :meth:`sshade.pipeline.regions.HandleRegions.keep_volume`.
    sample : callable
        V_N and the handles on it, by default with M's handle vertices among V_N.
    projection : callable
        P, by default onto the fan around a vertex's sample; see :data:`sshade.carry.projection.Projector`.
    progress : Progress
    **options
        Vertices, frames and number of the proxies, threads and seed; see
        :class:`sshade.pipeline.proxies.ProxyOptions`. By default 5 samplings, as in the paper.

    Returns
    -------
    DeformationResult
        ``seconds`` are summed over samplings, which overlap in time, and so do
        ``bind`` and ``solve`` of each.
        ``iterations`` is the mean over samplings, ``converged`` is true if all did.
        ``extra`` has the number of ``samples`` of each, the ``faces_without_area`` of the mesh,
        the largest ``residual``, the number of ``degenerate_frames``, and
        ``proxy_energy``, ``proxy_volume_error`` and the like: means, and largest errors, of what
        the coarse method says of its proxies.

    Raises
    ------
    InputError
        On a mesh or options out of the above.
    """
    given: ProxyOptions = {"samplings": 5, **options}
    proxies = Proxies(task.mesh, handles=len(task.handles), **given)
    regions = HandleRegions(task.mesh, task.handles, vertices=proxies.vertices, graph=proxies.graph)
    if regions.covered:
        return all_on_targets(task)
    solve = coarse or local_global
    first: Future[np.ndarray] = Future()  # M' of the first sampling

    def one_sampling(number: int) -> DeformationResult:
        # 1. Sample M: V_N, a subset of V_M, and its triangles.
        begin = perf_counter()
        sampling, handles = sample(task, regions, (proxies.seed, number))
        sampled = perf_counter()
        proxy_task = DeformationTask(
            f"{task.name} proxy {number}",
            proxy_mesh(task.mesh, sampling),
            handles,
            guess=first.result()[sampling.samples] if warm_start and number else None,
        )
        spent = {"solve": 0.0, "carry": 0.0}

        def bound() -> Binding:
            binding = bind_proxy(task.mesh, sampling, frames=proxies.frames, projection=projection)
            regions.prepare()
            return binding

        def solved_and_carried(start: DeformationTask, **goal: float) -> _Carried:
            # 3. Deform the proxy: N'.
            begin = perf_counter()
            solved = solve(
                start,
                seed=proxies.seed,
                progress=lambda _, done, total, note="": progress(
                    f"sampling {number + 1}", done, total, note
                ),
                **goal,
            )
            spent["solve"] += perf_counter() - begin
            binding = binds.result()
            # 4. Carry M along: M' decoded in the frames of N'.
            begin = perf_counter()
            with ThreadTeam(proxies.carriers) as team:
                R = solved.extra.get("rotations")
                V, degenerate = binding.carry(solved.vertices, rotations=R, team=team)
            if keep_volume:
                V = regions.on_targets(V, task.handles)
            spent["carry"] += perf_counter() - begin
            return _Carried(solved, V, degenerate)

        with ThreadPoolExecutor(max_workers=1) as pool:
            # 2. Project M onto N, and encode it in N's frames; that needs no N', and runs beside 3.
            binds = pool.submit(bound)
            carried = solved_and_carried(proxy_task)
        if keep_volume:
            carried = _keeping_volume(carried, solved_and_carried, proxy_task, regions)
        solved, V, degenerate = carried
        binding = binds.result()
        return DeformationResult(
            vertices=V,
            iterations=solved.iterations,
            converged=solved.converged,
            seconds={"remesh": sampled - begin, **binding.seconds, **spent},
            extra={
                "proxy_vertices": binding.proxy.n,
                "added_samples": sampling.added,
                "degenerate_frames": degenerate,
                "residual": solved.extra.get("residual", float("nan")),
                **{f"proxy_{name}": fact for name, fact in solved.extra.items() if f"proxy_{name}" in FACTS},
            },
        )

    def first_shared(number: int) -> DeformationResult:
        try:
            result = one_sampling(number)
        except BaseException as error:
            if number == 0:
                first.set_exception(error)
            raise
        if number == 0:
            first.set_result(result.vertices)
        return result

    # 5. Average the M' of k samplings.
    mean = proxies.average(first_shared if warm_start else one_sampling)
    if keep_volume:  # each M' is on its targets
        return replace(mean, vertices=regions.keep_volume(mean.vertices))
    return replace(mean, vertices=regions.on_targets(mean.vertices, task.handles))


class _Carried(NamedTuple):
    """N' as solved, M' (n, 3) carried with it, and the number of frames that were degenerate."""

    solved: DeformationResult
    V: np.ndarray
    degenerate: int


def _keeping_volume(
    carried: _Carried,
    solved_and_carried: Callable[..., _Carried],
    proxy_task: DeformationTask,
    regions: HandleRegions,
) -> _Carried:
    """Solve on from N', which knows little of the inside of regions, to the volume with which M' has its own.

    The iterations are those of all solves. A proxy that does not hold its volume exactly stays.
    """
    goal, lacking, iterations = 1.0, regions.lacking_volume(carried.V), carried.solved.iterations
    for _ in range(VOLUME_ROUNDS):
        if abs(lacking) <= VOLUME_ERROR * abs(regions.volume):
            break
        goal += lacking / proxy_task.mesh.volume
        if carried.solved.extra.get("volume_constraint") != "exact" or goal <= 0:
            break
        again = solved_and_carried(replace(proxy_task, guess=carried.solved.vertices), volume_goal=goal)
        iterations += again.solved.iterations
        left = regions.lacking_volume(again.V)
        if again.solved.extra["volume_constraint"] != "exact" or abs(left) >= abs(lacking):
            break
        facts = {**carried.solved.extra, **again.solved.extra}
        carried, lacking = again._replace(solved=replace(again.solved, extra=facts)), left
    return carried._replace(solved=replace(carried.solved, iterations=iterations))
