"""Deformations a second once a mesh is bound."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from eval.timing.timing import say
from sshade.pipeline.deformer import Deformer
from sshade.task import DeformationTask

#: Steps of the drag.
STEPS = 60
#: The dynamic handles go this fraction of their way within the drag; the rest before it.
LAST_PART = 0.1
#: Each step stops at this residual or number of iterations; the next one goes on from there.
FLUID = {"tolerance": 1e-4, "max_iterations": 15}
#: After release.
EXACT = {"tolerance": 1e-7, "max_iterations": 5000}


def drag(task: DeformationTask, *, vertices: int) -> None:
    """Drag the handles over the last part of their way and print frames a second, then release.

    Parameters
    ----------
    task : DeformationTask
    vertices : int
        Proxy vertices.
    """
    rest, target = task.mesh.V[task.handles.index], task.handles.target
    begin = perf_counter()
    deformer = Deformer(task.mesh, task.handles.index, vertices=vertices)
    bound = perf_counter() - begin
    deformer(rest + (1 - LAST_PART) * (target - rest))
    seconds = []
    for step in range(1, STEPS + 1):
        targets = rest + (1 - LAST_PART * (1 - step / STEPS)) * (target - rest)
        begin = perf_counter()
        deformer(targets, **FLUID)
        seconds.append(perf_counter() - begin)
    median, slow = np.median(seconds), np.percentile(seconds, 95)
    say(
        f"bound in {bound:.2f} s; drag of {STEPS} steps, 1 sampling: {1 / median:.0f} deformations a second "
        f"in the median ({1e3 * median:.1f} ms, 95th percentile {1e3 * slow:.1f} ms), decoding included"
    )
    released = deformer(target, **EXACT)
    deformer.reset()
    cold = deformer(target, **EXACT)
    energies = released.extra["energy"][0], cold.extra["energy"][0]
    gap = np.linalg.norm(released.vertices - cold.vertices, axis=1).max() / task.mesh.diagonal
    say(
        f"released and solved to a residual of {released.extra['residual']:.1e} (cold: "
        f"{cold.extra['residual']:.1e}): energies {energies[0]:.6g} and {energies[1]:.6g} (cold), "
        f"{abs(energies[0] / energies[1] - 1):.1e} apart; positions {gap:.1e} of the diagonal apart at most"
    )
