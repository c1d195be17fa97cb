"""SShaDe from end to end: bind a mesh to proxies, deform them, carry the mesh along, average."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from time import perf_counter
from typing import Any, Literal

import numpy as np

from sshade.carry.binding import Binding, bind_proxy, require_binding
from sshade.carry.frames import FrameKind
from sshade.carry.projection import sent_far
from sshade.errors import InputError
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.sampling.remesh import Remesh, proxy_mesh, remesh
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask, Handles, Method, Progress, silent
from sshade.threads import in_threads

#: What a coarse method may tell, and the result then does too.
PROXY_FACTS = (
    "energy",
    "volume_error",
    "area_error",
    "volume_constraint",
    "area_constraint",
    "coarser_iterations",
)


def deform(
    task: DeformationTask,
    *,
    vertices: int = 6000,
    samplings: int = 5,
    coarse: Method | None = None,
    frames: FrameKind = "triangle",
    frame_function: str | np.ndarray = "extent",
    projection: Literal["fan", "surface"] = "fan",
    handle_mode: Literal["samples", "nearest"] = "samples",
    warm_start: bool = False,
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """SShaDe: deform a proxy of the mesh and carry the mesh along with local frames.

    Parameters
    ----------
    task : DeformationTask
        Its mesh must be manifold, oriented and of one component; boundary is fine.
    vertices : int
        Vertices of each proxy N; the paper's is 6000.
    samplings : int
        k, the number of different proxies whose results are averaged; the paper's is 5.
    coarse : Method, optional
        Deforms the proxy; by default :func:`sshade.solver.local_global.local_global`,
        accelerated spokes-and-rims ARAP.
    frames : {"triangle", "affine", "blended", "blended_affine"}
        What carries the mesh along; see :func:`sshade.bind`. ``blended`` takes
        the proxy's rotations from the coarse method where it gives them.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f, whose gradient directs ``triangle`` frames; see :func:`sshade.carry.frames.frame_values`.
    projection : {"fan", "surface"}
        P, restricted to the fan around a vertex's sample, or ReMatching's U.
    handle_mode : {"samples", "nearest"}
        ``samples``: handle vertices are vertices of every proxy. ``nearest``:
        the sample nearest to a handle takes its place, and its motion.
    warm_start : bool
        Solve the later proxies from the first one's result instead of from the
        coarse method's own start: fewer iterations, and all in one basin.
    workers : int, optional
        Threads that share the samplings; by default two for each CPU. The
        result does not depend on it.
    seed : int
        The samplings differ in the random vertex that follows the handles.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``seconds`` are summed over samplings, which overlap in time, and so do
        ``bind`` and ``solve`` of each.
        ``iterations`` is the mean over samplings, ``converged`` is true if all did.
        ``extra`` has the mean number ``far_vertices`` that the projection put onto
        another part of the surface (:func:`sshade.carry.projection.sent_far`), and the
        same as ``far_share`` in percent; ``proxy_energy``, ``proxy_volume_error`` and the like are
        the means, and the largest errors, of what the coarse method tells of its proxies.

    Raises
    ------
    InputError
        On a mesh or parameters out of the above.

    References
    ----------
    F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
    deformation via local representations", algorithm 1.
    """
    if samplings < 1:
        raise InputError(f"{samplings} samplings were asked for; at least one is needed")
    if handle_mode not in ("samples", "nearest"):
        raise InputError(f"unknown handle mode {handle_mode!r}; use 'samples' or 'nearest'")
    require_binding(task.mesh, projection=projection, frames=frames, frame_function=frame_function)
    task.mesh.require_manifold()
    task.mesh.require_one_component()
    begin = perf_counter()
    graph = vertex_graph(task.mesh)
    shared = perf_counter() - begin
    first: Future[np.ndarray] = Future()

    def run(number: int) -> DeformationResult:
        stage = f"sampling {number + 1}"
        try:
            result = _one_sampling(
                task,
                number,
                graph,
                vertices=vertices,
                coarse=coarse or local_global,
                frames=frames,
                frame_function=frame_function,
                projection=projection,
                handle_mode=handle_mode,
                guess=first.result if warm_start and number else None,
                seed=seed,
                progress=lambda _, done, total, note="": progress(stage, done, total, note),
            )
        except BaseException as error:
            if number == 0:
                first.set_exception(error)
            raise
        if number == 0:
            first.set_result(result.vertices)
        return result

    results = in_threads(run, samplings, workers=workers)
    begin = perf_counter()
    total = sum((result.vertices for result in results[1:]), start=results[0].vertices)
    seconds = {
        stage: sum(r.seconds[stage] for r in results) for stage in ("remesh", "bind", "solve", "carry")
    }
    seconds["remesh"] += shared
    far = float(np.mean([r.extra["far_vertices"] for r in results]))
    return DeformationResult(
        vertices=total / samplings,
        iterations=float(np.mean([r.iterations for r in results])),
        converged=_all_converged([r.converged for r in results]),
        seconds={**seconds, "average": perf_counter() - begin},
        extra={
            "samplings": samplings,
            "proxy_vertices": float(np.mean([r.extra["proxy_vertices"] for r in results])),
            "added_samples": sum(r.extra["added_samples"] for r in results),
            "degenerate_frames": sum(r.extra["degenerate_frames"] for r in results),
            "far_vertices": far,
            "far_share": 100 * far / task.mesh.n,
            "residual": max(r.extra["residual"] for r in results),
            **_of_proxies([r.extra["proxy"] for r in results]),
        },
    )


def _of_proxies(found: list[dict[str, Any]]) -> dict[str, Any]:
    """What the solvers of the proxies tell of energy and constraints, for all samplings together."""
    facts: dict[str, Any] = {}
    for name, value in found[0].items():
        values = [each[name] for each in found]
        if isinstance(value, str):
            facts[f"proxy_{name}"] = ", ".join(dict.fromkeys(values))
        else:
            facts[f"proxy_{name}"] = float(max(values) if name.endswith("error") else np.mean(values))
    return facts


def _one_sampling(
    task: DeformationTask,
    number: int,
    graph: VertexGraph,
    *,
    vertices: int,
    coarse: Method,
    frames: FrameKind,
    frame_function: str | np.ndarray,
    projection: Literal["fan", "surface"],
    handle_mode: str,
    guess: Callable[[], np.ndarray] | None,
    seed: int,
    progress: Progress,
) -> DeformationResult:
    """M' from one proxy; `guess` waits for an M' to begin from."""
    begin = perf_counter()
    first = task.handles.index if handle_mode == "samples" else None
    remeshed = remesh(task.mesh, vertices, first=first, seed=(seed, number), graph=graph)
    sampled = perf_counter()
    handles = proxy_handles(task.handles, task.mesh, remeshed, mode=handle_mode)
    proxy_task = DeformationTask(
        f"{task.name} proxy {number}",
        proxy_mesh(task.mesh, remeshed),
        handles,
        guess=guess()[remeshed.samples] if guess else None,
    )
    # Where the mesh's vertices are on the proxy, the coarse method need not know.
    with ThreadPoolExecutor(max_workers=1) as pool:
        bound = pool.submit(
            bind_proxy,
            task.mesh,
            remeshed,
            projection=projection,
            frames=frames,
            frame_function=frame_function,
        )
        begin_solve = perf_counter()
        solved = coarse(proxy_task, seed=seed, progress=progress)
        end = perf_counter()
        binding = bound.result()
    ready = perf_counter()
    V, degenerate = binding.carry(solved.vertices, rotations=solved.extra.get("rotations"))
    carried = perf_counter()
    return DeformationResult(
        vertices=V,
        iterations=solved.iterations,
        converged=solved.converged,
        seconds={
            "remesh": sampled - begin,
            **binding.seconds,
            "solve": end - begin_solve,
            "carry": carried - ready,
        },
        extra={
            "far_vertices": _far_vertices(binding) if projection == "surface" else 0,
            "proxy_vertices": binding.proxy.n,
            "added_samples": binding.remesh.added,
            "degenerate_frames": degenerate,
            "residual": solved.extra.get("residual", float("nan")),
            "proxy": {name: solved.extra[name] for name in PROXY_FACTS if name in solved.extra},
        },
    )


def _far_vertices(binding: Binding) -> int:
    """How many vertices the unrestricted map put onto another part of the surface."""
    region, radius = binding.remesh.region, float(binding.remesh.distance.max())
    return int(sent_far(binding.projection, binding.proxy, region=region, radius=radius).sum())


def proxy_handles(handles: Handles, mesh: Mesh, remeshed: Remesh, *, mode: str = "samples") -> Handles:
    """The handles of M as handles of its proxy.

    Parameters
    ----------
    handles : Handles
        On M.
    mesh : Mesh
        M.
    remeshed : Remesh
        With the handle vertices first, if `mode` is ``samples``.
    mode : {"samples", "nearest"}
        ``nearest`` gives each handle to the sample of its region. A static one
        stays at its place; a dynamic one goes where the handle's motion takes
        it: t_i + R (p_s - p_i), with the rotation of the handle's group; of
        several handles at one sample the mean is taken.
    """
    if mode == "samples":
        return Handles(np.arange(len(handles)), handles.target, dynamic=handles.dynamic, group=handles.group)
    sample = remeshed.region[handles.index].astype(np.int64)
    at_sample, at_handle = mesh.V[remeshed.samples[sample]], mesh.V[handles.index]
    moved = np.where(handles.dynamic[:, None], handles.target, at_sample)
    for group in np.unique(handles.group[handles.dynamic]):
        own = handles.dynamic & (handles.group == group)
        R, _ = rigid_motion(at_handle[own], handles.target[own])
        moved[own] += (at_sample[own] - at_handle[own]) @ R.T
    index, first, inverse, count = np.unique(
        sample, return_index=True, return_inverse=True, return_counts=True
    )
    mean = np.stack([np.bincount(inverse, moved[:, c]) for c in range(3)], axis=1) / count[:, None]
    dynamic = np.bincount(inverse, handles.dynamic) > 0
    return Handles(index, mean, dynamic=dynamic, group=handles.group[first], merged=len(sample) - len(index))


def _all_converged(each: list[bool | None]) -> bool | None:
    return None if any(c is None for c in each) else all(each)
