"""Sample a mesh and bind it to the proxy, without handles."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.incidence import members
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.problem.options import Options, checked
from sshade.proxy.binding import Binding, FrameKind, bind_proxy, frame_maker
from sshade.proxy.frames import FrameMaker
from sshade.proxy.sample import SPARE, Sampling, proxy_vertices, sample_proxy, shared_vertices


def bind(
    mesh: Mesh,
    vertices: int = Options.vertices,
    *,
    coarser: int = Options.coarser,
    first: np.ndarray | None = None,
    seed: int | tuple[int, ...] = 0,
    frames: FrameKind | FrameMaker = "triangle",
    graph: VertexGraph | None = None,
) -> Binding:
    """Sample a mesh M to a proxy N, project M onto N and encode M in N's frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold and oriented; one component, if there is `first`.
    vertices, coarser, frames
        See :class:`sshade.problem.options.Options`.
    first : (h,) int, optional
        Vertices of M that become the first vertices of N.
    seed : int or tuple of int
        Chooses the random vertex that follows them.
    graph : VertexGraph, optional
        The mesh's :func:`sshade.mesh.adjacency.vertex_graph`, if several bindings share it.

    Raises
    ------
    InputError
        See :func:`sshade.proxy.sample.sample_proxy` and :func:`sshade.proxy.binding.frame_maker`.
    """
    require_mesh(mesh, "bind")
    sizes = checked({"vertices": vertices, "coarser": coarser}, ("vertices", "coarser"), subject="bind")
    vertices, coarser = sizes["vertices"], sizes["coarser"]
    maker = frame_maker(frames)
    begin = perf_counter()
    count = proxy_vertices(vertices, mesh.n, 0 if first is None else len(first), coarser=coarser)
    if first is None and mesh.connectivity.components > 1:
        sampling = sample_components(mesh, count, seed=seed)
    else:
        sampling = sample_proxy(mesh, count, first=first, seed=seed, graph=graph)
    seconds = {"remesh": perf_counter() - begin}
    binding = bind_proxy(mesh, sampling, frames=maker)
    return replace(binding, seconds={**seconds, **binding.seconds})


def sample_components(
    mesh: Mesh, vertices: int, *, first: np.ndarray | None = None, seed: int | tuple[int, ...] = 0
) -> Sampling:
    """Sample each component of an oriented manifold.

    Parameters
    ----------
    mesh : Mesh
        Oriented and manifold.
    vertices : int
        Total number of samples, distributed over components by area.
    first : (h,) int, optional
        Vertices that must be samples. Each component gets its own, and a few samples more.
    seed : int or tuple of int
        See :func:`sshade.proxy.sample.sample_proxy`.
    """
    count, of_face = mesh.connectivity.components, mesh.component[mesh.F[:, 0]]
    size, area = np.bincount(mesh.component), np.bincount(of_face, mesh.face_areas)
    first = np.empty(0, dtype=np.int64) if first is None else first
    least = np.minimum(size, np.bincount(mesh.component[first], minlength=count) + SPARE)
    share = shared_vertices(vertices, area, least, size)
    parts, taken = [], 0
    cell, distance = np.empty(mesh.n, dtype=np.int32), np.empty(mesh.n)
    for number, (vertex, faces) in enumerate(
        zip(members(mesh.component, count), members(of_face, count), strict=True)
    ):
        part = mesh.part(vertex, faces)
        if part.diagonal == 0 or share[number] == part.n:  # the component itself is the proxy
            sampling = Sampling(np.arange(part.n), part.F, np.arange(part.n), np.zeros(part.n))
        else:
            own = np.searchsorted(vertex, first[mesh.component[first] == number])
            sampling = sample_proxy(part, int(share[number]), first=own, seed=seed)
        cell[vertex], distance[vertex] = sampling.cell + taken, sampling.distance
        parts.append((vertex[sampling.samples], sampling.faces + taken))
        taken += len(sampling.samples)
    samples, triangles = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Sampling(samples, triangles, cell, distance)
