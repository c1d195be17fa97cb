"""The proxies of a mesh: how they are sampled and bound, and how their results are averaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from time import perf_counter
from typing import Any, TypedDict

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.carry.frames import FrameMaker
from sshade.carry.kinds import FrameKind, frame_maker
from sshade.errors import InputError
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.sampling.proxy import sample_proxy
from sshade.task import DeformationResult
from sshade.threads import available_cpus, in_threads, number_of_workers

#: Vertices of a mesh over those of its proxy, at least.
COARSER = 4
#: Vertices of a proxy by default, as in the paper.
VERTICES = 6000
#: Vertices of a proxy besides its handles, at least, and for how many of these there is room: more are
#: thinned.
SPARE, HANDLES = 4, 1500
#: Vertices of a mesh from which on threads share those that one proxy carries along.
SHARED = 50_000


def least_vertices(handles: int) -> int:
    """Vertices of a proxy for so many handles, where the mesh has them."""
    return min(handles, HANDLES) + SPARE


def proxy_vertices(asked: int, n: int, handles: int = 0, *, coarser: int = COARSER) -> int:
    """How many vertices of a mesh a proxy samples: those asked for, of a small mesh a quarter.

    Below four vertices for each of its own a proxy has no detail to leave out. Whatever the
    mesh's size, there is room for handles: see :func:`least_vertices`.

    Parameters
    ----------
    asked : int
        Fewer than the handles are given back as they are, for the sampling to thin or to refuse.
    n : int
        Vertices of the mesh.
    handles : int
        Handle vertices.
    coarser : int
        Vertices of the mesh over those of the proxy, at least.
    """
    return min(asked, n, max(n // coarser, least_vertices(handles)))


class ProxyOptions(TypedDict, total=False):
    """The keyword options of everything that makes proxies, as ``**options: Unpack[ProxyOptions]``.

    Attributes
    ----------
    vertices : int
        Vertices of each proxy N, before refinement adds the few that the topology needs;
        :data:`VERTICES` by default, and a quarter of the mesh's at most: see
        :func:`proxy_vertices`. ``samples`` in the `extra` of a result says how many they were.
    coarser : int
        Vertices of the mesh over those of a proxy, at least; 4 by default.
    samplings : int
        k, the number of different proxies whose results are averaged.
    frames : {"triangle", "affine", "blended", "blended_affine"} or FrameMaker
        The local frames that carry M along; see :func:`sshade.carry.kinds.frame_maker`. The
        paper's are ``triangle``.
    frame_function : {"extent", "best", "x", "y", "z"} or (n,) float64
        f, whose gradient directs ``triangle`` frames; see :func:`sshade.carry.triangle.frame_values`.
        By default ``extent``.
    workers : int, optional
        Threads that share the samplings; by default two for each CPU. No influence on results.
    seed : int
        The samplings differ in the random vertex that follows the handles, which it chooses.
    """

    vertices: int
    coarser: int
    samplings: int
    frames: FrameKind | FrameMaker
    frame_function: str | np.ndarray
    workers: int | None
    seed: int


class Proxies:
    """The proxies of a mesh for given options, and what they share.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component; boundary is fine.
    handles : int
        Handle vertices, which each proxy is to hold.
    vertices, coarser, samplings, frames, frame_function, workers, seed
        See :class:`ProxyOptions`.

    Raises
    ------
    InputError
        On another mesh, fewer than one sampling or worker, or unknown frames.
    """

    def __init__(
        self,
        mesh: Mesh,
        *,
        handles: int = 0,
        vertices: int = VERTICES,
        coarser: int = COARSER,
        samplings: int = 1,
        frames: FrameKind | FrameMaker = "triangle",
        frame_function: str | np.ndarray = "extent",
        workers: int | None = None,
        seed: int = 0,
    ) -> None:
        if samplings < 1:
            raise InputError(f"{samplings} samplings were asked for; at least one is needed")
        number_of_workers(workers, default=1)  # checked before any work
        self.frames = frame_maker(frames, mesh, frame_function=frame_function)
        mesh.require_manifold()
        mesh.require_one_component()
        begin = perf_counter()
        self.mesh, self.graph = mesh, vertex_graph(mesh)
        self._shared = perf_counter() - begin
        self._without_area = int(mesh.without_area.sum())
        self.vertices = proxy_vertices(vertices, mesh.n, handles, coarser=coarser)
        self.samplings, self.workers, self.seed = samplings, workers, seed

    def bind(self, number: int) -> Binding:
        """Sample and bind one proxy."""
        return bind(
            self.mesh,
            self.vertices,
            coarser=1,
            seed=(self.seed, number),
            frames=self.frames,
            graph=self.graph,
        )

    @property
    def carriers(self) -> int:
        """Threads that carry M along with each proxy: one where samplings share the CPUs, or M is small."""
        return available_cpus() if self.samplings == 1 and self.mesh.n >= SHARED else 1

    def average(self, one: Callable[[int], DeformationResult]) -> DeformationResult:
        """The mean M' over samplings, ``one(0)`` to ``one(samplings - 1)``, which run in threads.

        Positions are summed in the order of the samplings, whatever the number of threads, and
        each is let go of once it is in the sum. ``seconds`` are summed; for ``extra`` see
        :data:`FACTS`.
        """
        mean = _RunningMean(self.samplings)

        def summed(number: int) -> DeformationResult:
            result = one(number)
            mean.add(number, result.vertices)
            return replace(result, vertices=np.empty((0, 3)))

        results = in_threads(summed, self.samplings, workers=self.workers)
        total = mean.total / self.samplings if self.samplings > 1 else mean.total
        facts = {
            "samplings": self.samplings,
            "samples": self.vertices,
            "faces_without_area": self._without_area,
        }
        first = results[0].seconds
        if "remesh" in first:
            results[0] = replace(results[0], seconds={**first, "remesh": first["remesh"] + self._shared})
        return joined(total, results, FACTS, extra=facts)


def bind(
    mesh: Mesh,
    vertices: int = VERTICES,
    *,
    coarser: int = COARSER,
    first: np.ndarray | None = None,
    seed: int | tuple[int, ...] = 0,
    frames: FrameKind | FrameMaker = "triangle",
    frame_function: str | np.ndarray = "extent",
    graph: VertexGraph | None = None,
) -> Binding:
    """Sample a mesh M to a proxy N, project M onto N and encode M in N's frames.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    vertices, coarser, frames, frame_function
        See :class:`ProxyOptions`.
    first : (h,) int, optional
        Vertices of M that become the first ones of N.
    seed : int or tuple of int
        Chooses the random vertex that follows them.
    graph : VertexGraph, optional
        The mesh's :func:`sshade.mesh.adjacency.vertex_graph`, where several bindings share it.

    Raises
    ------
    InputError
        See :func:`sshade.sampling.proxy.sample_proxy`, :func:`sshade.carry.kinds.frame_maker` and
        :func:`sshade.carry.triangle.frame_values`.
    """
    maker = frame_maker(frames, mesh, frame_function=frame_function)
    begin = perf_counter()
    count = proxy_vertices(vertices, mesh.n, 0 if first is None else len(first), coarser=coarser)
    sampling = sample_proxy(mesh, count, first=first, seed=seed, graph=graph)
    seconds = {"remesh": perf_counter() - begin}
    binding = bind_proxy(mesh, sampling, frames=maker)
    return replace(binding, seconds={**seconds, **binding.seconds})


class _RunningMean:
    """The sum of arrays that come in any order, added up in the order of their numbers."""

    def __init__(self, count: int) -> None:
        self.total: Any = None
        self._next, self._early, self._lock = 0, dict[int, np.ndarray](), Lock()

    def add(self, number: int, array: np.ndarray) -> None:
        """Add an array, once all those of lower numbers are in."""
        with self._lock:
            self._early[number] = array
            while self._next in self._early:
                array = self._early.pop(self._next)
                self.total = array if self._next == 0 else self.total + array
                self._next += 1


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _distinct(values: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(values))


#: What one fact of an average is, from those of its samplings; others are left out.
FACTS: Mapping[str, Callable[[Any], Any]] = {
    "proxy_vertices": _mean,
    "added_samples": sum,
    "degenerate_frames": sum,
    "residual": max,
    "energy": list,
    "proxy_energy": _mean,
    "proxy_volume_error": max,
    "proxy_area_error": max,
    "proxy_volume_constraint": _distinct,
    "proxy_area_constraint": _distinct,
    "proxy_coarser_iterations": _mean,
    "proxy_basin": _distinct,
}


def joined(
    vertices: np.ndarray,
    results: Sequence[DeformationResult],
    facts: Mapping[str, Callable[[Any], Any]],
    *,
    extra: Mapping[str, Any] | None = None,
) -> DeformationResult:
    """One result for several: mean iterations, converged if all are, seconds summed, facts by their rules.

    Parameters
    ----------
    vertices : (n, 3) float64
    results : sequence of DeformationResult
    facts : mapping
        For names in ``extra`` what makes one value of those of the results that have it.
    extra : mapping, optional
        Further facts.
    """
    converged = [result.converged for result in results]
    stages = dict.fromkeys(stage for result in results for stage in result.seconds)
    found = {name: [r.extra[name] for r in results if name in r.extra] for name in facts}
    return DeformationResult(
        vertices=vertices,
        iterations=_mean([result.iterations for result in results]),
        converged=None if None in converged else all(converged),
        seconds={stage: sum(r.seconds.get(stage, 0.0) for r in results) for stage in stages},
        extra={**(extra or {}), **{name: facts[name](values) for name, values in found.items() if values}},
    )
