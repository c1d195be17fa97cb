"""Bind once, deform many times: new targets only re-solve the proxies and decode."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from time import perf_counter
from typing import Any, Unpack

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.pipeline.proxies import Proxies, ProxyOptions
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.solver.local_global import LocalGlobal
from sshade.task import DeformationResult, DeformationTask, Handles, Progress, silent
from sshade.threads import in_threads


def _known_of(handles: Handles, own: np.ndarray, on: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """The rotations of those handles that are vertices `on` (s,) of a proxy, by their number `own` (s,)."""
    if handles.rotation is None:
        return None
    known = Handles(on, handles.target[own], rotation=handles.rotation[own]).known
    if handles.known and not known:
        raise InputError("no handle with a rotation is a vertex of the proxy; ask for more vertices")
    return known


class Deformer:
    """A mesh bound to its proxies, with everything that does not depend on the targets.

    Remeshes, projections, frames and factorisations are made once. Each call
    starts from the shape and the rotations that the last one ended with, so
    that small moves of the handles take a few iterations: a drag. The first
    call with given targets equals :func:`sshade.sshade` with the same
    options, bit for bit.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    index : (h,) int
        Handle vertices, each once; their targets come with each call, in this order.
    weight : (h,) float64 or float
        Of soft handles, see :class:`sshade.Handles`; inf by default.
    progress : Progress
    **options
        See :class:`sshade.pipeline.proxies.ProxyOptions`. By default one sampling, the choice for
        interaction.

    Raises
    ------
    InputError
        On a mesh or options out of the above.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Deformer, Mesh
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> drag = Deformer(mesh, [0, 2], vertices=4, samplings=1)
    >>> drag(V[[0, 2]] + [0, 0, 1]).vertices.shape
    (4, 3)
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        *,
        weight: np.ndarray | float = inf,
        progress: Progress = silent,
        **options: Unpack[ProxyOptions],
    ) -> None:
        self.mesh, self.index = mesh, np.array(index, dtype=np.int64)
        mesh.require_handles(self.index)
        if len(np.unique(self.index)) < len(self.index):
            raise InputError("a handle vertex is given twice")
        self._weight = weight
        handles = self._task(mesh.V[self.index]).handles
        self._proxies = proxies = Proxies(mesh, handles=len(self.index), **options)
        self._regions = regions = HandleRegions(mesh, handles, vertices=proxies.vertices, graph=proxies.graph)

        def make(number: int) -> tuple[Binding, LocalGlobal, np.ndarray]:
            remeshed, handle = regions.sample((proxies.seed, number))
            binding = bind_proxy(mesh, remeshed, frames=proxies.frames)
            on = np.flatnonzero(handle >= 0)
            on_proxy = handles.sampled(handle[on], on, mesh.V)
            solver = LocalGlobal(binding.proxy, on, stiffness=on_proxy.stiffness)
            progress("binding", number + 1, proxies.samplings)
            return binding, solver, handle[on]

        made = [] if regions.covered else in_threads(make, proxies.samplings, workers=proxies.workers)
        self.bindings = [binding for binding, _, _ in made]
        self.solvers = [solver for _, solver, _ in made]
        self._handles = [handle for _, _, handle in made]  # of the index, those on each proxy
        self.reset()

    def _task(self, targets: np.ndarray, rotation: np.ndarray | None = None) -> DeformationTask:
        handles = Handles(self.index, targets, weight=np.asarray(self._weight), rotation=rotation)
        return DeformationTask("drag", self.mesh, handles)

    def reset(self) -> None:
        """Forget the last shape: the next call starts from the rest shape."""
        self._start: list[dict[str, Any]] = [{} for _ in self.solvers]

    def __call__(
        self,
        targets: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
    ) -> DeformationResult:
        """Deform for new targets of the same handles, from where the last call ended.

        Parameters
        ----------
        targets : (h, 3) float64
            In the order of `index`.
        rotations : (h, 3, 3) float64, optional
            Of the handles, NaN where open; see :class:`sshade.Handles`.
        tolerance : float
            Residual, relative to the proxy's diagonal, under which iteration stops.
        max_iterations : int
            Cutoff; a handful keeps a drag fluid, and the next call goes on.

        Returns
        -------
        DeformationResult
            As of :func:`sshade.sshade`; ``extra`` holds the largest
            ``residual`` and the proxies' ``energy``.
        """
        begin = perf_counter()
        if self._regions.covered:
            return all_on_targets(self._task(targets))
        targets = np.asarray(targets, dtype=np.float64)
        if targets.shape != (len(self.index), 3):
            raise InputError(
                f"{len(self.index)} handles need targets of shape ({len(self.index)}, 3), not {targets.shape}"
            )
        handles = self._task(targets, rotations).handles
        ends: list[dict[str, Any]] = [{} for _ in self.solvers]

        def one_sampling(number: int) -> DeformationResult:
            solver, own = self.solvers[number], self._handles[number]
            solution = solver.solve(
                targets[own],
                known=_known_of(handles, own, solver.index),
                tolerance=tolerance,
                max_iterations=max_iterations,
                **self._start[number],
            )
            ends[number] = {"start": solution.positions, "rotations": solution.rotations}
            V, degenerate = self.bindings[number].carry(solution.positions, rotations=solution.rotations)
            facts = {
                "residual": solution.residual,
                "energy": solution.energy,
                "degenerate_frames": degenerate,
            }
            return DeformationResult(V, solution.iterations, solution.converged, extra=facts)

        result = self._proxies.average(one_sampling)
        self._start = ends
        V = self._regions.on_targets(result.vertices, handles)
        return replace(result, vertices=V, seconds={"total": perf_counter() - begin})
