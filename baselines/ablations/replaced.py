"""The method `paper` and transfers with a part replaced, for the ablations.

Three parts can be replaced: where handles go on the proxy, where vertices go on it, and the frames
(:mod:`baselines.ablations.named_frames`). ReMatching's map U takes the nearest point of the whole proxy, in
place of P (:mod:`sshade.proxy.projection`). Where two parts of the surface nearly touch, U puts vertices on
the wrong part.

Proof: with nothing replaced, results equal those of the method bit for bit, and frames follow their formulas
(tests/baselines/test_named_frames.py); U takes the nearest of all triangles
(tests/baselines/test_ablations.py).

F. Maggioli, D. Baieri, S. Melzi, E. Rodola, "ReMatching: low-resolution representations for
scalable shape correspondence", 2024.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from baselines.ablations.named_frames import FrameName, FunctionName, named_frames
from baselines.hard_handles import require_hard
from sshade.core.progress import Progress, silent
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.method.bound import Bound
from sshade.method.piece import Recipe
from sshade.method.transfer import transfer
from sshade.problem.options import PROXIES, accepted, resolve, takes_options
from sshade.problem.task import DeformationResult, DeformationTask, Handles, TransferTask
from sshade.proxy.projection import Projection, project_to_fans
from sshade.proxy.sample import Sampling, sample_proxy
from sshade.regions.handle_regions import HandleRegions
from sshade.regions.placement import Placement, sample_with_handles

#: Distance beyond which a projection crosses to another part of the surface, in covering radii. Samples of
#: touching cells are at most two covering radii and one edge of M apart.
FAR = 2.0


@takes_options(accepted("paper"))
def paper_with(
    task: DeformationTask,
    *,
    projection: Literal["fan", "surface"] = "fan",
    handle_mode: Literal["samples", "nearest"] = "samples",
    frames: FrameName = "triangle",
    frame_function: FunctionName = "extent",
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Deform by the method `paper` with another projection, other handles on the proxy, or other frames.

    Parameters
    ----------
    task : DeformationTask
    projection : {"fan", "surface"}
        P, onto the fan around a vertex's sample, or U, onto the whole proxy.
    handle_mode : {"samples", "nearest"}
        Handle vertices as vertices of every proxy, or handles given to the samples of their cells.
    frames, frame_function
        See :func:`baselines.ablations.named_frames.named_frames`.
    progress : Progress
    **options
        See :class:`sshade.problem.options.Options`.

    Returns
    -------
    DeformationResult
        ``extra`` has besides the mean number ``far_vertices`` of cross-part projections
        (:func:`cross_part`), and the same as ``far_share`` in percent.

    Raises
    ------
    InputError
        As :func:`sshade.deform` and :func:`baselines.ablations.named_frames.named_frames`.
    """
    projections = {"fan": project_to_fans, "surface": project_to_surface}
    samplers = {"samples": sample_with_handles, "nearest": sample_nearest_to_handles}
    if handle_mode == "nearest":
        require_hard(task.handles, "the handle mode nearest")
    options["frames"] = named_frames(frames, frame_function)
    counts = []

    def counted(V: np.ndarray, proxy: Mesh, sampling: Sampling) -> Projection:
        found = projections[projection](V, proxy, sampling)
        counts.append(int(cross_part(found, proxy, sampling).sum()))
        return found

    recipe = Recipe(samplers[handle_mode], counted)
    bound = Bound.of_task(task, resolve("paper", options), recipe=recipe)
    result = bound.solve(task.handles, guess=task.guess, progress=progress)
    far = float(np.mean(counts or 0))  # no proxy where every vertex is a handle
    facts = {"far_vertices": far, "far_share": 100 * far / task.mesh.n}
    return replace(result, extra={**result.extra, **facts})


@takes_options(PROXIES)
def transfer_with(
    task: TransferTask,
    *,
    frames: FrameName = "triangle",
    frame_function: FunctionName = "extent",
    residual: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Transfer a pose with other frames.

    Parameters
    ----------
    task : TransferTask
    frames, frame_function
        See :func:`baselines.ablations.named_frames.named_frames`.
    residual, progress, **options
        See :func:`sshade.method.transfer.transfer`.

    Raises
    ------
    InputError
        As :func:`sshade.method.transfer.transfer` and :func:`baselines.ablations.named_frames.named_frames`.
    """
    maker = named_frames(frames, frame_function)
    return transfer(task, frames=maker, residual=residual, progress=progress, **options)


def project_to_surface(V: np.ndarray, proxy: Mesh, sampling: Sampling) -> Projection:
    """U: the nearest point of the whole proxy N.

    Parameters
    ----------
    V : (n, 3) float64
        Vertices of M.
    proxy : Mesh
        N.
    sampling : Sampling
        Unused: regions do not restrict U.
    """
    import igl

    _, face, point = igl.point_mesh_squared_distance(V, np.array(proxy.V), np.array(proxy.F))
    corners = proxy.V[proxy.F[face]]
    barycentric = igl.barycentric_coordinates(point, *(np.ascontiguousarray(corners[:, c]) for c in range(3)))
    return Projection(np.asarray(face, dtype=np.int64), barycentric)


def cross_part(projection: Projection, proxy: Mesh, sampling: Sampling) -> np.ndarray:
    """Find vertices that a projection takes to another part of the surface.

    For such a vertex, the shortest path along edges of N from the vertex's sample to a corner of its triangle
    is longer than :data:`FAR` covering radii. The covering radius is the largest graph distance of a vertex
    of M to its sample. N has the topology of M, so no short path leads from an arm to the torso that the arm
    touches. P never crosses, because the sample is a corner of every triangle of its fan.

    Parameters
    ----------
    projection : Projection
    proxy : Mesh
        N.
    sampling : Sampling

    Returns
    -------
    (n,) bool
    """
    graph, region = vertex_graph(proxy), sampling.cell
    lengths = csr_array((graph.lengths, graph.indices, graph.indptr), shape=(proxy.n, proxy.n))
    corners = proxy.F[projection.face]
    far = (corners != region[:, None]).all(axis=1)
    samples, row = np.unique(region[far], return_inverse=True)
    if len(samples):
        # Infinite beyond the limit.
        ways = dijkstra(lengths, indices=samples, limit=FAR * float(sampling.distance.max()))
        far[far] = np.isinf(ways[row[:, None], corners[far]].min(axis=1))
    return far


def sample_nearest_to_handles(
    mesh: Mesh, regions: HandleRegions, seed: tuple[int, int]
) -> tuple[Sampling, Placement]:
    """Sample M without regard to handles; each handle goes to the sample of its cell.

    A static handle stays at the sample's place. A dynamic one goes where the handle's motion takes it:
    t_i + R (p_s - p_i), with R the rotation of the handle's group. Several handles at one sample are replaced
    by their mean.

    Parameters
    ----------
    mesh, regions, seed
        See :func:`sshade.regions.placement.sample_with_handles`.
    """
    sampling = sample_proxy(mesh, regions.vertices, seed=seed, graph=regions.graph)

    def place(handles: Handles) -> Handles:
        sample = sampling.cell[handles.index].astype(np.int64)
        at_sample, at_handle = mesh.V[sampling.samples[sample]], mesh.V[handles.index]
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
        return Handles(index, mean, dynamic=dynamic, group=handles.group[first])

    return sampling, Placement(place)
