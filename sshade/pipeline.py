"""SShaDe from end to end: bind a mesh to a proxy, deform the proxy, carry the mesh along."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Literal
from zipfile import BadZipFile

import numpy as np

from sshade.errors import InputError
from sshade.frames import TriangleFrames
from sshade.local_global import local_global
from sshade.mesh import Mesh
from sshade.projection import Projection, project_to_fans, project_to_surface
from sshade.remesh import Remesh, proxy_mesh, remesh
from sshade.task import DeformationResult, DeformationTask, Handles, Method, Progress, rigid_motion, silent


@dataclass(frozen=True, eq=False)
class Binding:
    """A mesh M tied to a proxy N: what carries any deformation of N back to M.

    Parameters
    ----------
    remesh : Remesh
    proxy : Mesh
        N at rest.
    projection : Projection
        Where each vertex of M lies on N.
    frames : TriangleFrames
        L_t and b_t on N.
    local : (n, 3) float64
        Coordinates of M's vertices in the frames of their triangles.
    seconds : mapping
        Time of the stages ``remesh`` and ``bind``.
    """

    remesh: Remesh
    proxy: Mesh
    projection: Projection
    frames: TriangleFrames
    local: np.ndarray
    seconds: dict[str, float]

    def carry(self, NV: np.ndarray) -> tuple[np.ndarray, int]:
        """M' for the vertices of N', and the number of triangles without a frame of their own.

        Parameters
        ----------
        NV : (k, 3) float64
            Vertices of N', in the proxy's numbering.

        Returns
        -------
        V : (n, 3) float64
        degenerate : int

        Raises
        ------
        InputError
            When `NV` has another shape than the proxy's vertices.
        """
        NV = np.ascontiguousarray(NV, dtype=np.float64)
        if NV.shape != self.proxy.V.shape:
            raise InputError(f"the proxy has vertices of shape {self.proxy.V.shape}, not {NV.shape}")
        return self.frames.decode(self.local, self.projection.face, NV)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write what :meth:`load` needs besides the mesh, as an .npz."""
        with open(path, "wb") as file:
            np.savez(
                file,
                vertices=len(self.local),
                samples=self.remesh.samples,
                faces=self.remesh.faces,
                region=self.remesh.region,
                distance=self.remesh.distance,
                face=self.projection.face,
                barycentric=self.projection.barycentric,
                to_proxy=self.projection.distance,
                values=self.frames.values,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str], mesh: Mesh) -> Binding:
        """Read a binding written by :meth:`save`, for the mesh that it was made of.

        Raises
        ------
        InputError
            When the file is unreadable, incomplete, or of a mesh with other counts.
        """
        try:
            with np.load(path) as data:
                arrays = {name: data[name] for name in data.files}
            if arrays["vertices"] != mesh.n or arrays["samples"].max() >= mesh.n:
                raise InputError(
                    f"the map is of a mesh with {arrays['vertices']} vertices, this one has {mesh.n}"
                )
            remeshed = Remesh(*(arrays[name] for name in ("samples", "faces", "region", "distance")))
            on_proxy = Projection(*(arrays[name] for name in ("face", "barycentric", "to_proxy")))
            _require_fit(remeshed, on_proxy, arrays["values"], mesh.n)
            proxy = proxy_mesh(mesh, remeshed)
            frames = TriangleFrames.of_values(proxy, arrays["values"])
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except (OSError, KeyError, IndexError, TypeError, ValueError, EOFError, BadZipFile) as error:
            raise InputError(f"{path}: not a map written by `sshade remesh` ({error})") from error
        return cls(remeshed, proxy, on_proxy, frames, frames.encode(mesh.V, on_proxy.face), {})


def _require_fit(remeshed: Remesh, on_proxy: Projection, values: np.ndarray, n: int) -> None:
    """Raise ValueError unless the arrays of a map fit together: kernels would read out of bounds."""
    k, faces = len(remeshed.samples), len(remeshed.faces)
    for ids, end in ((remeshed.region, k), (on_proxy.face, faces)):
        if ids.shape != (n,) or ids.min() < 0 or ids.max() >= end:
            raise ValueError("its arrays do not fit together")
    if values.shape != (faces, 3) or remeshed.samples.min() < 0:
        raise ValueError("its arrays do not fit together")


def bind(
    mesh: Mesh,
    vertices: int = 6000,
    *,
    first: np.ndarray | None = None,
    seed: int | tuple[int, ...] = 0,
    projection: Literal["fan", "surface"] = "fan",
    frame_function: str | np.ndarray = "extent",
) -> Binding:
    """Remesh M to a proxy N and encode M's vertices in N's frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    vertices : int
        Proxy vertices, before refinement adds the few that the topology needs.
    first : (h,) int, optional
        Vertices of M that become the first ones of N.
    seed : int or tuple of int
        Chooses the random vertex that follows them.
    projection : {"fan", "surface"}
        P, or ReMatching's U.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f; an array gives its value at each vertex of M.

    Raises
    ------
    InputError
        See :func:`sshade.remesh.remesh` and :func:`sshade.frames.frame_values`.
    """
    if projection not in ("fan", "surface"):
        raise InputError(f"unknown projection {projection!r}; use 'fan' or 'surface'")
    begin = perf_counter()
    remeshed = remesh(mesh, vertices, first=first, seed=seed)
    proxy = proxy_mesh(mesh, remeshed)
    sampled = perf_counter()
    if projection == "fan":
        on_proxy = project_to_fans(mesh.V, proxy, remeshed.region)
    else:
        on_proxy = project_to_surface(mesh.V, proxy)
    if not isinstance(frame_function, str):
        frame_function = np.asarray(frame_function)
        if frame_function.shape != (mesh.n,):
            raise InputError(
                f"a frame function needs {mesh.n} values, one a vertex, not {frame_function.shape}"
            )
        frame_function = frame_function[remeshed.samples]
    frames = TriangleFrames.at_rest(proxy, frame_function)
    local = frames.encode(mesh.V, on_proxy.face)
    seconds = {"remesh": sampled - begin, "bind": perf_counter() - sampled}
    return Binding(remeshed, proxy, on_proxy, frames, local, seconds)


def deform(
    task: DeformationTask,
    *,
    vertices: int = 6000,
    samplings: int = 5,
    coarse: Method | None = None,
    frame_function: str | np.ndarray = "extent",
    projection: Literal["fan", "surface"] = "fan",
    handle_mode: Literal["samples", "nearest"] = "samples",
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
        Deforms the proxy; by default :func:`sshade.local_global.local_global`,
        accelerated spokes-and-rims ARAP.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f, whose gradient directs the frames; see :func:`sshade.frames.frame_values`.
    projection : {"fan", "surface"}
        P, restricted to the fan around a vertex's sample, or ReMatching's U.
    handle_mode : {"samples", "nearest"}
        ``samples``: handle vertices are vertices of every proxy. ``nearest``:
        the sample nearest to a handle takes its place, and its motion.
    workers : int, optional
        Threads that share the samplings; by default one a processor. The
        result does not depend on it.
    seed : int
        The samplings differ in the random vertex that follows the handles.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``seconds`` are summed over samplings, which overlap in time.
        ``iterations`` is the mean over samplings, ``converged`` is true if all did.

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
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers were asked for; at least one is needed")
    if handle_mode not in ("samples", "nearest"):
        raise InputError(f"unknown handle mode {handle_mode!r}; use 'samples' or 'nearest'")
    task.mesh.require_manifold()
    task.mesh.require_one_component()
    one = partial(
        _one_sampling,
        task,
        vertices=vertices,
        coarse=coarse or local_global,
        frame_function=frame_function,
        projection=projection,
        handle_mode=handle_mode,
        seed=seed,
    )
    results = _run_all(one, samplings, workers or os.cpu_count() or 1, progress)
    begin = perf_counter()
    total = results[0].vertices
    for result in results[1:]:
        total = total + result.vertices
    seconds = {
        stage: sum(r.seconds[stage] for r in results) for stage in ("remesh", "bind", "solve", "carry")
    }
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
            "residual": max(r.extra["residual"] for r in results),
            "engine": results[0].extra["engine"],
        },
    )


def _run_all(
    one: Callable[..., DeformationResult], samplings: int, workers: int, progress: Progress
) -> list[DeformationResult]:
    """The results of all samplings, in order, whatever the number of threads."""

    def run(i: int) -> DeformationResult:
        return one(
            i, progress=lambda _, done, total, note="": progress(f"sampling {i + 1}", done, total, note)
        )

    if min(workers, samplings) == 1:
        return [run(i) for i in range(samplings)]
    with ThreadPoolExecutor(max_workers=min(workers, samplings)) as pool:
        futures = [pool.submit(run, i) for i in range(samplings)]
        try:
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _one_sampling(
    task: DeformationTask,
    number: int,
    *,
    vertices: int,
    coarse: Method,
    frame_function: str | np.ndarray,
    projection: Literal["fan", "surface"],
    handle_mode: str,
    seed: int,
    progress: Progress,
) -> DeformationResult:
    """M' from one proxy."""
    binding = bind(
        task.mesh,
        vertices,
        first=task.handles.index if handle_mode == "samples" else None,
        seed=(seed, number),
        projection=projection,
        frame_function=frame_function,
    )
    begin = perf_counter()
    handles = proxy_handles(task.handles, task.mesh, binding.remesh, mode=handle_mode)
    proxy_task = DeformationTask(f"{task.name} proxy {number}", binding.proxy, handles)
    solved = coarse(proxy_task, seed=seed, progress=progress)
    end = perf_counter()
    V, degenerate = binding.carry(solved.vertices)
    return DeformationResult(
        vertices=V,
        iterations=solved.iterations,
        converged=solved.converged,
        seconds={**binding.seconds, "solve": end - begin, "carry": perf_counter() - end},
        extra={
            "proxy_vertices": binding.proxy.n,
            "added_samples": binding.remesh.added,
            "degenerate_frames": degenerate,
            "residual": solved.extra.get("residual", float("nan")),
            "engine": solved.extra.get("engine", ""),
        },
    )


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
