"""A start for the proxy's solver from a proxy of the proxy, and that one's from a leading energy.

Far moves take a local/global solver the most iterations, and need the least detail: on a mesh
of a sixth of the vertices they take a sixth of the time, to a tenth of the accuracy. From there
the minimum of the proxy's energy is near.

Which minimum, the start decides: handles alone leave it open to which side a knee bends. There the
minimum of another energy can lead, one that says more of where everything goes; another start is tried
beside it, for the energy that counts. More starts do not pay: the rest, and handles taken to their targets in
steps, end lower by more than a few per cent only where a far twist collapses and runs through itself.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from sshade.errors import InputError
from sshade.pipeline.paper import sshade
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask

log = logging.getLogger(__name__)

#: Meshes with fewer vertices are solved as quickly without.
SMALLEST = 3000
#: Vertices of a mesh over those of its proxy, at most; and of the proxy over the handles, at least.
RATIO, ROOM = 6, 2
#: Tolerance on the coarser level over that asked for.
ROUGH = 10.0
#: Energy from the solver's own start over that from the lead's result, below which the first is taken.
CLEARLY_LOWER = 0.9


def multilevel(
    task: DeformationTask,
    *,
    coarse: Callable[..., DeformationResult],
    lead: Callable[..., DeformationResult] | None = None,
    tolerance: float = 1e-5,
    volume_goal: float = 1.0,
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Solve from the result on a coarser proxy, where there can be one, and else as `coarse` does alone.

    Parameters
    ----------
    task : DeformationTask
        Of the proxy. There is no coarser one for a task with a guess, with fewer than
        :data:`SMALLEST` vertices, or with many handles; nor for a mesh so thin that fewer samples
        cannot keep its topology.
    coarse : callable
        The solver, on both levels: ``coarse(task, tolerance=, seed=, progress=)``, which begins
        at the task's guess where there is one; on the last level it is given ``volume_goal=``, too.
    lead : callable, optional
        A solver, as `coarse`: on the coarsest level `coarse` begins at its result, and once more at a
        start of its own, which wins where its energy is below :data:`CLEARLY_LOWER` times the other.
    tolerance, volume_goal : float
        As of :func:`sshade.solver.local_global.local_global`; a coarser level holds its own volume.
    seed : int
        Of the sampling.
    progress : Progress

    Returns
    -------
    DeformationResult
        As of `coarse`. Without a guess, ``extra`` has the ``coarser_iterations``, 0 without a coarser proxy,
        and with a `lead` the ``basin`` that the result is in: "lead" or "start".

    Raises
    ------
    InputError
        Those of `coarse`.
    """
    options: dict[str, Any] = {"tolerance": tolerance, "volume_goal": volume_goal}
    options |= {"seed": seed, "progress": progress}
    if task.guess is not None:
        return coarse(task, **options)
    size, iterations = max(task.mesh.n // RATIO, ROOM * len(task.handles)), 0.0
    first, facts = coarse, dict[str, str]()
    if lead:
        first = partial(_better, coarse=coarse, lead=lead, facts=facts)
    if task.mesh.n >= SMALLEST and size <= task.mesh.n // ROOM:
        rougher = partial(first, tolerance=ROUGH * tolerance)
        try:
            rough = sshade(
                task,
                vertices=size,
                coarser=ROOM,
                samplings=1,
                coarse=rougher,
                frames="blended",
                seed=seed,
            )
        except InputError as error:
            log.info("%s: solved without a coarser proxy of %d vertices: %s", task.name, size, error)
        else:
            task, iterations, first = replace(task, guess=rough.vertices), rough.iterations, coarse
    result = first(task, **options)
    return replace(result, extra={**result.extra, **facts, "coarser_iterations": iterations})


def _better(
    task: DeformationTask,
    *,
    coarse: Callable[..., DeformationResult],
    lead: Callable[..., DeformationResult],
    facts: dict[str, str],
    **options: Any,
) -> DeformationResult:
    """The result from the lead's, or from a start of its own; `facts` gets the ``basin``."""
    led = coarse(replace(task, guess=lead(task, **options).vertices), **options)
    own = coarse(task, **options)
    lower = own.extra["energy"] < CLEARLY_LOWER * led.extra["energy"]
    facts["basin"] = "start" if lower else "lead"
    return own if lower else led
