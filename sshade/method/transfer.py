"""Pose transfer and isometric reconstruction: poses that are known at the samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import count
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from sshade.core.progress import Progress, silent
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.cutting import Cut, cut_surface, mean_of_copies
from sshade.mesh.mesh import Mesh
from sshade.method.piece import mean_of, of_samplings, threads_of
from sshade.problem.facts import Facts
from sshade.problem.options import PROXIES, TRANSFER_SAMPLINGS, Options, checked, takes_options
from sshade.problem.task import DeformationResult, TransferTask
from sshade.proxy.bind import bind
from sshade.proxy.binding import frame_maker
from sshade.proxy.frames import FrameMaker
from sshade.proxy.sample import proxy_vertices


@takes_options(PROXIES)
def transfer(
    task: TransferTask,
    *,
    residual: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Transfer a pose: move an edited shape S as M moves to its pose M'.

    A proxy N is sampled on M, and its posed positions N' are read off M'. The vertices of S get coordinates
    in the frames of N, and positions from the frames of N'. Nothing is solved.

    Parameters
    ----------
    task : TransferTask
        `mesh` is S, `rest` is M and `posed` is M'. If M is no oriented manifold, it is cut, and joined again.
    residual : bool
        Add to each vertex the difference between M' and its reconstruction from the proxy.
        Vertices that were not edited then end exactly on M'. This reads M' at every vertex, and is not in the
        paper. Without it, only the samples of M' are used.
    progress : Progress
    **options
        See the options :data:`sshade.problem.options.PROXIES` of :class:`sshade.problem.options.Options`.
        By default 10 samplings, as in the paper.

    Returns
    -------
    DeformationResult
        S', with ``seconds`` summed over samplings.

    Raises
    ------
    InputError
        If M cannot be cut, or on an unknown option or a value out of its range.

    References
    ----------
    F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
    deformation via local representations", the sections on isometric and pose transfer.
    """
    given = checked(options, PROXIES, subject="transfer")
    resolved = Options(**{"samplings": TRANSFER_SAMPLINGS, **given})
    cut = cut_surface(task.rest)
    rest, posed = cut.mesh, task.posed[cut.origin]
    edited = None if task.mesh.V is task.rest.V else task.mesh.V[cut.origin]
    frames = frame_maker(resolved.frames)
    begin = perf_counter()
    graph = vertex_graph(rest)
    graph_seconds = perf_counter() - begin
    samples = proxy_vertices(resolved.vertices, rest.n, coarser=resolved.coarser)
    shapes = _Shapes(cut, posed, edited, samples, frames, graph, resolved.seed, residual)
    report = partial(_report, progress, resolved.samplings, count())
    report()
    run = partial(_one_sampling, shapes, report)
    with ThreadPoolExecutor(max_workers=threads_of(resolved)) as pool:
        mean, results = mean_of(pool.map(run, range(resolved.samplings)))
    return of_samplings(mean, results, graph_seconds=graph_seconds).of(task)


class _Shapes(NamedTuple):
    """What all samplings of a transfer share: M, M' and S, cut to manifolds, and how M is sampled."""

    cut: Cut
    posed: np.ndarray
    edited: np.ndarray | None
    samples: int
    frames: FrameMaker
    graph: VertexGraph
    seed: int
    residual: bool


def _report(progress: Progress, samplings: int, ended: Iterator[int]) -> None:
    progress("samplings", next(ended), samplings)


def _one_sampling(shapes: _Shapes, report: Callable[[], None], number: int) -> DeformationResult:
    """Transfer the pose by one proxy."""
    seed, rest = (shapes.seed, number), shapes.cut.mesh
    frames, graph = shapes.frames, shapes.graph
    binding = bind(rest, shapes.samples, coarser=1, seed=seed, frames=frames, graph=graph)
    NV, on = shapes.posed[binding.sampling.samples], binding.projection
    local = binding.local if shapes.edited is None else binding.frames.encode(shapes.edited, on)
    begin = perf_counter()
    V, degenerate = binding.frames.decode(local, NV, on=on)
    if shapes.residual:
        V = V + (shapes.posed - binding.frames.decode(binding.local, NV, on=on)[0])
    V = mean_of_copies(shapes.cut, V)
    report()
    seconds = {**binding.seconds, "carry": perf_counter() - begin}
    facts = Facts(
        samples=shapes.samples,
        samplings=1,
        degenerate_frames=degenerate,
        faces_without_area=int(rest.without_area.sum()),
    )
    return DeformationResult(V, 0, None, seconds, facts=facts)


def transfer_pose(
    mesh: Mesh,
    posed: np.ndarray,
    edited: np.ndarray | None = None,
    *,
    residual: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """:func:`transfer` of shapes given by their vertices.

    Parameters
    ----------
    mesh : Mesh
        M.
    posed : (n, 3) float64
        M', in correspondence with M.
    edited : (n, 3) float64, optional
        S, in correspondence with M. By default M itself: the result rebuilds M' from its
        samples (isometric reconstruction), and its distance from M' is the error of the
        proxies and frames.
    residual, progress, **options
        See :func:`transfer`.
    """
    shape = mesh if edited is None else Mesh(mesh.checked(edited, "edited shape"), mesh.F)
    task = TransferTask("transfer", shape, mesh, posed)
    return transfer(task, residual=residual, progress=progress, **options)
