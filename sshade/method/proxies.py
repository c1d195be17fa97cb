"""The proxies of a mesh: how they are sampled and bound, and how their results are averaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from time import perf_counter
from typing import Any

import numpy as np

from sshade.core.threads import available_cpus, in_threads
from sshade.mesh.adjacency import VertexGraph, vertex_graph
from sshade.mesh.ids import members
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.problem.options import Options, checked
from sshade.problem.task import DeformationResult
from sshade.proxy.binding import Binding, bind_proxy
from sshade.proxy.frames import FrameMaker
from sshade.proxy.kinds import FrameKind, frame_maker
from sshade.proxy.sample import Sampling, sample_proxy

#: Smallest number of proxy vertices besides the handles.
SPARE = 4
#: Number of handles that always find room on a proxy; more handles are thinned.
HANDLES = 1500
#: Number of mesh vertices from which on several threads prolong N' to M'.
LARGE = 50_000


def least_vertices(handles: int) -> int:
    """Return the smallest number of proxy vertices for a number of handles."""
    return min(handles, HANDLES) + SPARE


def proxy_vertices(asked: int, n: int, handles: int = 0, *, coarser: int = Options.coarser) -> int:
    """Return how many vertices a proxy samples: `asked`, but of a small mesh at most ``n // coarser``.

    A proxy with more than a quarter of the vertices has no detail to leave out. Handles find room whatever
    the mesh's size: see :func:`least_vertices`.

    Parameters
    ----------
    asked : int
        Fewer vertices than handles are returned unchanged; the sampling thins the handles or refuses.
    n : int
        Vertices of the mesh.
    handles : int
        Handle vertices.
    coarser : int
        Smallest ratio of the mesh's vertices to the proxy's.
    """
    return min(asked, n, max(n // coarser, least_vertices(handles)))


def shared_vertices(asked: int, area: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Distribute proxy vertices over components by area, within the numbers that the components can use.

    Parameters
    ----------
    asked : int
        Wanted total.
    area : (c,) float64
        Of each component.
    least, most : (c,) int
        Smallest and largest number of each component. A component takes no more than its largest number; the
        rest goes to the other components.

    Returns
    -------
    (c,) int64
        Their sum is `asked` up to rounding, unless all components have their smallest or largest numbers.
    """
    share, free = np.array(least, dtype=np.float64), np.ones(len(area), dtype=bool)
    while (total := area[free].sum()) > 0:
        share[free] = (asked - share[~free].sum()) / total * area[free]
        low, high = free & (share < least), free & (share > most)
        # With more to give back than to add, the components at their largest numbers stay there.
        fixed = high if (share - most)[high].sum() >= (least - share)[low].sum() else low
        if not fixed.any():
            break
        share[fixed] = np.clip(share, least, most)[fixed]
        free &= ~fixed
    # Components without area have their smallest number.
    return np.round(np.clip(share, least, most)).astype(np.int64)


class Proxies:
    """The proxies of a mesh for given options, and the data that they share.

    Parameters
    ----------
    mesh : Mesh
        M: manifold and oriented; a boundary is fine.
    options : Options
        The options of :data:`sshade.problem.options.PROXIES`.
    handles : int
        Number of handle vertices, which each proxy is to have.

    Raises
    ------
    InputError
        On another mesh, or a frame function that does not fit the mesh.
    """

    def __init__(self, mesh: Mesh, options: Options, *, handles: int = 0) -> None:
        self.frames = frame_maker(options.frames, mesh, frame_function=options.frame_function)
        begin = perf_counter()
        self.mesh, self.graph = mesh, vertex_graph(mesh)
        self._graph_seconds = perf_counter() - begin
        self._without_area = int(mesh.without_area.sum())
        self.vertices = proxy_vertices(options.vertices, mesh.n, handles, coarser=options.coarser)
        self.samplings, self.workers, self.seed = options.samplings, options.workers, options.seed

    @property
    def carriers(self) -> int:
        """Number of threads that prolong each N' to M': one if samplings share the CPUs, or M is small."""
        return available_cpus() if self.samplings == 1 and self.mesh.n >= LARGE else 1

    def average(self, deform: Callable[[int], DeformationResult]) -> DeformationResult:
        """Average M' over samplings, ``deform(0)`` to ``deform(samplings - 1)``, which run in threads.

        Positions are summed in the order of the samplings, whatever the number of threads. The memory of
        each M' is freed once it is in the sum. ``seconds`` are summed; ``extra`` follows :data:`FACTS`.
        """
        mean = _RunningMean(self.samplings)

        def summed(number: int) -> DeformationResult:
            result = deform(number)
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
            seconds = {**first, "remesh": first["remesh"] + self._graph_seconds}
            results[0] = replace(results[0], seconds=seconds)
        return joined(total, results, FACTS, extra=facts)


def bind(
    mesh: Mesh,
    vertices: int = Options.vertices,
    *,
    coarser: int = Options.coarser,
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
        M: manifold and oriented; one component, if there is `first`.
    vertices, coarser, frames, frame_function
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
        See :func:`sshade.proxy.sample.sample_proxy`, :func:`sshade.proxy.kinds.frame_maker` and
        :func:`sshade.proxy.triangle.frame_values`.
    """
    require_mesh(mesh, "bind")
    sizes = checked({"vertices": vertices, "coarser": coarser}, ("vertices", "coarser"), subject="bind")
    vertices, coarser = sizes["vertices"], sizes["coarser"]
    maker = frame_maker(frames, mesh, frame_function=frame_function)
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
        part = Mesh(mesh.V[vertex], np.searchsorted(vertex, mesh.F[faces]))
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


class _RunningMean:
    """The sum of arrays that come in any order, added up in the order of their numbers."""

    def __init__(self, count: int) -> None:
        self.total: Any = None
        self._next, self._early, self._lock = 0, dict[int, np.ndarray](), Lock()

    def add(self, number: int, array: np.ndarray) -> None:
        """Add an array as soon as all arrays of lower numbers are in the sum."""
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


#: How the facts of samplings are combined into a fact of their average; other facts are dropped.
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
    "proxy_initialisation": _distinct,
}


def joined(
    vertices: np.ndarray,
    results: Sequence[DeformationResult],
    facts: Mapping[str, Callable[[Any], Any]],
    *,
    extra: Mapping[str, Any] | None = None,
) -> DeformationResult:
    """Join results into one: mean iterations, converged if all are, seconds summed, facts by their rules.

    Parameters
    ----------
    vertices : (n, 3) float64
    results : sequence of DeformationResult
    facts : mapping
        For each name in ``extra`` the function that combines the values of the results that have it.
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
