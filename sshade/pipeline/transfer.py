"""Poses that are known at the samples: isometric reconstruction and pose transfer."""

from __future__ import annotations

from time import perf_counter
from typing import Literal

import numpy as np

from sshade.carry.binding import bind
from sshade.carry.frames import FrameKind
from sshade.errors import InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationResult, Progress, silent
from sshade.threads import in_threads

STAGES = ("remesh", "bind", "carry")


def transfer_pose(
    mesh: Mesh,
    posed: np.ndarray,
    edited: np.ndarray,
    *,
    vertices: int = 6000,
    samplings: int = 10,
    frames: FrameKind = "triangle",
    frame_function: str | np.ndarray = "extent",
    projection: Literal["fan", "surface"] = "fan",
    residual: bool = False,
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Put an edited shape S into the pose M' of the shape M that it was made from.

    The proxy N is sampled on M and its posed positions N' are read off M'. The
    vertices of S are expressed in the frames of N and read back in those of N'.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    posed : (n, 3) float64
        M', in correspondence with M. Only the rows of samples are used, unless `residual`.
    edited : (n, 3) float64
        S, in correspondence with M.
    vertices : int
        Vertices of each proxy; the paper's is 6000.
    samplings : int
        Proxies averaged; the paper's is 10.
    frames, frame_function, projection, workers
        As in :func:`sshade.deform`.
    residual : bool
        Add to each vertex what the proxy leaves out of M' there, so that frames carry
        the edit alone: vertices that were not edited end exactly on M'. Not in the
        paper; it reads M' at every vertex.
    seed : int
    progress : Progress

    Returns
    -------
    DeformationResult
        S', with ``seconds`` summed over samplings.

    Raises
    ------
    InputError
        On a mesh as :func:`sshade.bind` refuses, shapes that differ from M's, or
        positions that are not finite.

    References
    ----------
    F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
    deformation via local representations", the sections on isometric and pose transfer.
    """
    posed, edited = _checked(mesh, posed, "posed"), _checked(mesh, edited, "edited")
    if samplings < 1:
        raise InputError(f"{samplings} samplings were asked for; at least one is needed")
    begin = perf_counter()
    graph = vertex_graph(mesh)
    shared = perf_counter() - begin

    def one(number: int) -> tuple[np.ndarray, dict[str, float], int]:
        binding = bind(
            mesh,
            vertices,
            seed=(seed, number),
            projection=projection,
            frames=frames,
            frame_function=frame_function,
            graph=graph,
        )
        start = perf_counter()
        on = binding.projection
        local = binding.local if edited is mesh.V else binding.frames.encode(edited, on)
        V, degenerate = binding.frames.decode(local, posed[binding.remesh.samples], on=on)
        if residual:
            V = V + (posed - binding.frames.decode(binding.local, posed[binding.remesh.samples], on=on)[0])
        progress("samplings", number + 1, samplings)
        return V, {**binding.seconds, "carry": perf_counter() - start}, degenerate

    done = in_threads(one, samplings, workers=workers)
    total = sum((V for V, _, _ in done[1:]), start=done[0][0])
    seconds = {stage: sum(times[stage] for _, times, _ in done) for stage in STAGES}
    return DeformationResult(
        vertices=total / samplings,
        iterations=0,
        converged=None,
        seconds={**seconds, "remesh": seconds["remesh"] + shared},
        extra={"samplings": samplings, "degenerate_frames": sum(count for _, _, count in done)},
    )


def reconstruct(
    mesh: Mesh,
    posed: np.ndarray,
    *,
    vertices: int = 6000,
    samplings: int = 10,
    frames: FrameKind = "triangle",
    frame_function: str | np.ndarray = "extent",
    projection: Literal["fan", "surface"] = "fan",
    workers: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Rebuild a pose M' of M from its positions at the samples alone (isometric transfer).

    :func:`transfer_pose` with S = M; how near the result comes to M' tells what
    the proxy and the frames lose. Parameters and errors are the same.
    """
    return transfer_pose(
        mesh,
        posed,
        mesh.V,
        vertices=vertices,
        samplings=samplings,
        frames=frames,
        frame_function=frame_function,
        projection=projection,
        workers=workers,
        seed=seed,
        progress=progress,
    )


def _checked(mesh: Mesh, V: np.ndarray, name: str) -> np.ndarray:
    if V is mesh.V:
        return V
    V = np.ascontiguousarray(V, dtype=np.float64)
    if V.shape != mesh.V.shape:
        raise InputError(
            f"the {name} shape has vertices of shape {V.shape}, the rest mesh {mesh.V.shape}; "
            "they must correspond"
        )
    if not np.isfinite(V).all():
        raise InputError(f"the {name} shape has a NaN or infinite coordinate")
    return V
