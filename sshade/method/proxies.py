"""The proxies of a mesh, one for each sampling, and the average of their results."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import ThreadTeam, available_cpus, in_threads, number_of_workers
from sshade.mesh.mesh import Mesh
from sshade.method.proxy import Proxy, Shared, corrects_volume
from sshade.problem.options import Options
from sshade.problem.stop import Stop
from sshade.problem.task import DeformationResult, Handles, joined

#: Number of mesh vertices from which on several threads prolong N' to M'.
LARGE = 50_000


class Proxies:
    """The proxies of a connected, oriented manifold for some handles.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    handles : Handles
        Only their vertices, groups and weights matter, and which handles have a rotation.
    options : Options
    keep : bool
        Bind M to its proxies now and keep them: each deformation then starts from the last one. Otherwise
        each deformation makes new proxies.
    progress : Progress
        Of the bindings, if the proxies are kept.
    **hooks
        ``sample`` and ``projection``, see :class:`sshade.method.proxy.Shared`.

    Raises
    ------
    InputError
        On another mesh, or where it cannot be sampled.
    """

    def __init__(
        self,
        mesh: Mesh,
        handles: Handles,
        options: Options,
        *,
        keep: bool = False,
        progress: Progress = silent,
        **hooks: Any,
    ) -> None:
        self.mesh, self._options = mesh, options
        self._shared = Shared(mesh, handles, options, **hooks)
        #: Kept proxies; none if every vertex is a hard handle.
        self.kept: list[Proxy] = []
        if keep and not self.covered:
            bind = partial(self._kept_proxy, handles.at(mesh.V[handles.index], handles.rotation), progress)
            self.kept = in_threads(bind, options.samplings, workers=options.workers)

    @property
    def covered(self) -> bool:
        """Whether every vertex is a hard handle."""
        return self._shared.regions.covered

    @property
    def carriers(self) -> int:
        """Number of threads that prolong each N' to M': one if samplings share the CPUs, or M is small."""
        return available_cpus() if self._options.samplings == 1 and self.mesh.n >= LARGE else 1

    def _kept_proxy(self, handles: Handles, progress: Progress, number: int) -> Proxy:
        proxy = Proxy(self._shared, self._options, number, keep_for=handles)
        progress("binding", number + 1, self._options.samplings)
        return proxy

    def deform(
        self,
        handles: Handles,
        *,
        stop: Stop | None = None,
        guess: np.ndarray | None = None,
        settle: bool = True,
        team: ThreadTeam | None = None,
        out: np.ndarray | None = None,
        progress: Progress = silent,
    ) -> DeformationResult:
        """Average M' over the samplings, and put it on its targets or correct its volume.

        Parameters
        ----------
        handles : Handles
            Of M, at their targets.
        stop : Stop, optional
            By default the options' own.
        guess : (n, 3) float64, optional
            Shape in which the proxies start.
        settle : bool
            Correct volume and targets by further solves at once. Without it, only a first deformation is.
        team : ThreadTeam, optional
            Threads that prolong N' to M'.
        out : (n, 3) float64, C-contiguous, optional
            Takes the positions, if there is one proxy.
        progress : Progress
            Of proxies that are not kept.
        """
        options = self._options
        stop = stop or options.stop
        if self.kept and guess is not None:
            self.reset(guess)
        shared = self._shared
        with ThreadTeam(1 if team else self.carriers) as own_team:
            team = team or own_team
            if options.samplings == 1:
                proxy = self._proxy(guess, progress, 0)
                results = [proxy.deform(handles, stop=stop, settle=settle, team=team, out=out)]
                V = results[0].vertices
            else:

                def run(number: int) -> DeformationResult:
                    proxy = self._proxy(guess, progress, number)
                    return proxy.deform(handles, stop=stop, settle=settle, team=team)

                with ThreadPoolExecutor(max_workers=threads_of(options)) as pool:
                    V, results = mean_of(pool.map(run, range(options.samplings)))
        # With a corrected volume, each M' is on its targets.
        corrects = corrects_volume(options)
        V = shared.regions.correct_volume(V) if corrects else shared.regions.on_targets(V, handles)
        return of_samplings(V, results, graph_seconds=shared.graph_seconds)

    def _proxy(self, guess: np.ndarray | None, progress: Progress, number: int) -> Proxy:
        """Return a kept proxy, or a new one for one deformation."""
        if self.kept:
            return self.kept[number]
        return Proxy(self._shared, self._options, number, guess=guess, progress=progress)

    def reset(self, guess: np.ndarray | None = None) -> None:
        """Let kept proxies start at a shape (n, 3) of M, or as the method does."""
        for proxy in self.kept:
            proxy.reset(guess)

    def rebind(self, handles: Handles) -> None:
        """Let kept proxies take other handles of M, at rest; the shape stays.

        Raises
        ------
        InputError
            Where handles are too far from the vertices of a proxy. All proxies keep their handles then.
        """
        if not self.kept:
            raise InputError("all vertices were handles when the mesh was bound; make another Deformer")
        found = [proxy.rebound(handles) for proxy in self.kept]
        for proxy, (place, solver) in zip(self.kept, found, strict=True):
            proxy.use(place, solver)
        self._shared.set_handles(handles, self._options)


def threads_of(options: Options) -> int:
    """Return the number of threads that work on samplings: by default two for each CPU."""
    return min(options.samplings, number_of_workers(options.workers, default=2 * available_cpus()))


def mean_of(results: Iterable[DeformationResult]) -> tuple[np.ndarray, list[DeformationResult]]:
    """Return the mean (n, 3) of the positions of results, and the results without their positions.

    Positions are summed in the order of the results, so that the mean does not depend on the number of
    threads. The memory of each result is freed once it is in the sum.
    """
    total: Any = 0.0
    kept = []
    for result in results:
        total = total + result.vertices
        kept.append(replace(result, vertices=np.empty((0, 3))))
    return total / len(kept), kept


def of_samplings(
    V: np.ndarray, results: list[DeformationResult], *, graph_seconds: float
) -> DeformationResult:
    """Join results of samplings with the mean positions V (n, 3), and add the time of their common graph."""
    result = joined(V, results, "samplings")
    if "remesh" not in result.seconds:
        return result
    remesh = result.seconds["remesh"] + graph_seconds
    return replace(result, seconds={**result.seconds, "remesh": remesh})
