"""Bind once, deform many times: new targets only re-solve the proxies and decode."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, Unpack

import numpy as np

from sshade.carry.binding import Binding
from sshade.mesh.mesh import Mesh
from sshade.pipeline.proxies import Proxies, ProxyOptions
from sshade.solver.local_global import LocalGlobal
from sshade.task import DeformationResult, Progress, silent
from sshade.threads import in_threads


class Deformer:
    """A mesh bound to its proxies, with everything that does not depend on the targets.

    Remeshes, projections, frames and factorisations are made once. Each call
    starts from the shape and the rotations that the last one ended with, so
    that small moves of the handles take a few iterations: a drag. The first
    call with given targets equals :func:`sshade.deform` with the same
    options, bit for bit.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    index : (h,) int
        Handle vertices, each once; their targets come with each call, in this order.
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
        self, mesh: Mesh, index: np.ndarray, *, progress: Progress = silent, **options: Unpack[ProxyOptions]
    ) -> None:
        self.mesh, self.index = mesh, np.array(index, dtype=np.int64)
        self._proxies = proxies = Proxies(mesh, **options)

        def make(number: int) -> tuple[Binding, LocalGlobal]:
            binding = proxies.bind(number, first=self.index)
            solver = LocalGlobal(binding.proxy, np.arange(len(self.index)))
            progress("binding", number + 1, proxies.samplings)
            return binding, solver

        made = in_threads(make, proxies.samplings, workers=proxies.workers)
        self.bindings = [binding for binding, _ in made]
        self.solvers = [solver for _, solver in made]
        self.reset()

    def reset(self) -> None:
        """Forget the last shape: the next call starts from the rest shape."""
        self._start: list[dict[str, Any]] = [{} for _ in self.solvers]

    def __call__(
        self, targets: np.ndarray, *, tolerance: float = 1e-5, max_iterations: int = 1000
    ) -> DeformationResult:
        """Deform for new targets of the same handles, from where the last call ended.

        Parameters
        ----------
        targets : (h, 3) float64
            In the order of `index`.
        tolerance : float
            Residual, relative to the proxy's diagonal, under which iteration stops.
        max_iterations : int
            Cutoff; a handful keeps a drag fluid, and the next call goes on.

        Returns
        -------
        DeformationResult
            As of :func:`sshade.deform`; ``extra`` holds the largest
            ``residual`` and the proxies' ``energy``.
        """
        begin = perf_counter()
        ends: list[dict[str, Any]] = [{} for _ in self.solvers]

        def one_sampling(number: int) -> DeformationResult:
            solution = self.solvers[number].solve(
                targets, tolerance=tolerance, max_iterations=max_iterations, **self._start[number]
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
        return replace(result, seconds={"total": perf_counter() - begin})
