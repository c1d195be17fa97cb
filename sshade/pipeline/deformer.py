"""Bind once, deform many times: new targets only re-solve the proxies and decode."""

from __future__ import annotations

from time import perf_counter
from typing import Literal

import numpy as np

from sshade.carry.binding import Binding, bind
from sshade.carry.frames import FrameKind
from sshade.errors import InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.solver.local_global import LocalGlobal, Solution
from sshade.solver.options import Energy
from sshade.task import DeformationResult, Progress, silent
from sshade.threads import in_threads


class Deformer:
    """A mesh bound to its proxies, with everything that does not depend on the targets.

    Remeshes, projections, frames and factorisations are made once. Each call
    starts from the shape and the rotations that the last one ended with, so
    that small moves of the handles take a few iterations: a drag. The first
    call with given targets equals :func:`sshade.deform` with the same
    parameters, bit for bit.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    index : (h,) int
        Handle vertices, each once; their targets come with each call, in this order.
    vertices : int
        Proxy vertices N; the paper's 6000.
    samplings : int
        Proxies, whose results are averaged. One is the choice for interaction.
    energy : {"spokes", "spokes_and_rims"}
    frames, frame_function, projection
        As in :func:`sshade.bind`.
    workers : int, optional
        Threads that share the proxies; by default two for each CPU. No influence on results.
    seed : int
    progress : Progress

    Raises
    ------
    InputError
        On a mesh or parameters out of the above.

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
        vertices: int = 6000,
        samplings: int = 1,
        energy: Energy = "spokes_and_rims",
        frames: FrameKind = "triangle",
        frame_function: str | np.ndarray = "extent",
        projection: Literal["fan", "surface"] = "fan",
        workers: int | None = None,
        seed: int = 0,
        progress: Progress = silent,
    ) -> None:
        if samplings < 1:
            raise InputError(f"{samplings} samplings were asked for; at least one is needed")
        index = np.array(index, dtype=np.int64)
        self.mesh, self.index, self.workers = mesh, index, workers
        graph = vertex_graph(mesh)

        def make(number: int) -> tuple[Binding, LocalGlobal]:
            binding = bind(
                mesh,
                vertices,
                first=index,
                seed=(seed, number),
                projection=projection,
                frames=frames,
                frame_function=frame_function,
                graph=graph,
            )
            solver = LocalGlobal(binding.proxy, np.arange(len(index)), energy=energy)
            progress("binding", number + 1, samplings)
            return binding, solver

        made = in_threads(make, samplings, workers=workers)
        self.bindings = [binding for binding, _ in made]
        self.solvers = [solver for _, solver in made]
        self._last: list[Solution | None] = [None] * samplings

    def reset(self) -> None:
        """Forget the last shape: the next call starts from the rest shape."""
        self._last = [None] * len(self.solvers)

    def __call__(
        self,
        targets: np.ndarray,
        *,
        tolerance: float = 1e-5,
        max_iterations: int = 1000,
        progress: Progress = silent,
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
        progress : Progress

        Returns
        -------
        DeformationResult
            As of :func:`sshade.deform`; ``extra`` holds the largest
            ``residual`` and the proxies' ``energy``.
        """
        begin = perf_counter()

        def one(number: int) -> tuple[Solution, np.ndarray, int]:
            last = self._last[number]
            solution = self.solvers[number].solve(
                targets,
                start=None if last is None else last.positions,
                rotations=None if last is None else last.rotations,
                tolerance=tolerance,
                max_iterations=max_iterations,
                progress=progress,
            )
            return solution, *self.bindings[number].carry(solution.positions, rotations=solution.rotations)

        done = in_threads(one, len(self.solvers), workers=self.workers)
        self._last = [solution for solution, _, _ in done]
        total = sum((V for _, V, _ in done[1:]), start=done[0][1])
        return DeformationResult(
            vertices=total / len(done),
            iterations=float(np.mean([solution.iterations for solution, _, _ in done])),
            converged=all(solution.converged for solution, _, _ in done),
            seconds={"total": perf_counter() - begin},
            extra={
                "residual": max(solution.residual for solution, _, _ in done),
                "energy": [solution.energy for solution, _, _ in done],
                "degenerate_frames": sum(degenerate for _, _, degenerate in done),
            },
        )
