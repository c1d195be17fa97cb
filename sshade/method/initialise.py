"""Initialise the proxy solve on a coarser proxy, and choose its local minimum by a guide energy.

Large motions need many local/global iterations but little detail. A proxy with a sixth of the vertices
finds them in a sixth of the time, at a tenth of the accuracy; the solve on the full proxy then starts near
its minimum.

The initialisation also decides which minimum is found, because handles alone do not say to which side a
knee bends. On the coarsest proxy the solver therefore minimises a guide energy first, in which handles
attach whole parts of the body. It also starts once from the rest shape or the rigid motion of the handles.
The second result is used only where its energy is clearly lower. More starts do not pay: they end lower by
more than a few per cent only where a far twist collapses and intersects itself.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import Event
from typing import Any

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationResult, DeformationTask

log = logging.getLogger(__name__)

#: Number of vertices below which a coarser proxy saves no time.
SMALLEST = 3000
#: Ratio of a proxy's vertices to its coarser proxy's, and smallest ratio of the coarser proxy's vertices to
#: handles. ROOM is also the smallest ratio of vertices where many handles enlarge the coarser proxy.
RATIO, ROOM = 6, 2
#: Tolerance on the coarser proxy, as a multiple of the tolerance asked for.
ROUGH = 10.0
#: Ratio of energies below which the result from the plain start replaces the result from the guide.
CLEARLY_LOWER = 0.9

Solve = Callable[..., DeformationResult]


def initialised(
    task: DeformationTask,
    *,
    solve: Solve,
    guide: Solve | None,
    deform_coarsely: Callable[[DeformationTask, int, Solve], DeformationResult],
    tolerance: float,
    **options: Any,
) -> DeformationResult:
    """Solve on a proxy from the result on a coarser proxy, where a coarser proxy helps.

    Parameters
    ----------
    task : DeformationTask
        Of the proxy. Small proxies, below :data:`SMALLEST` vertices, proxies with many handles, and thin
        proxies whose topology a coarser proxy cannot keep are solved alone. A task with a guess starts there.
    solve : callable
        ``solve(task, tolerance=, **options)``, the solver on both proxies: it starts at the task's guess.
        With ``softened=True`` the guess is near the minimum.
    guide : callable, optional
        ``guide(task, tolerance=, **options)`` minimises the guide energy.
    deform_coarsely : callable
        ``deform_coarsely(task, vertices, coarse)`` deforms N through a coarser proxy, by the method
        `coarse`.
    tolerance : float
        Of the last solve.
    **options
        Passed to `solve`.

    Returns
    -------
    DeformationResult
        As of `solve`. Without a guess, ``extra`` has ``coarser_iterations``, 0 without a coarser proxy, and
        with a guide energy the ``initialisation`` of the result: "guide" or "handles".
    """
    options["tolerance"] = tolerance
    if task.guess is not None:
        return solve(task, **options)
    size, iterations, facts = max(task.mesh.n // RATIO, ROOM * len(task.handles)), 0.0, dict[str, str]()
    first = partial(_better, solve=solve, guide=guide, facts=facts) if guide else solve
    if task.mesh.n >= SMALLEST and size <= task.mesh.n // ROOM:
        try:
            rough = deform_coarsely(task, size, partial(first, tolerance=ROUGH * tolerance))
        except InputError as error:
            log.info("%s: solved without a coarser proxy of %d vertices: %s", task.name, size, error)
        else:
            task, iterations = replace(task, guess=rough.vertices), rough.iterations
            first = partial(solve, softened=True)
    result = first(task, **options)
    return replace(result, extra={**result.extra, **facts, "coarser_iterations": iterations})


def _better(
    task: DeformationTask, *, solve: Solve, guide: Solve, facts: dict[str, str], **options: Any
) -> DeformationResult:
    """Solve from the minimum of the guide energy and from the plain start, and return the better result.

    An error of one solve, such as an interrupt, ends the other at its next report of progress.
    """
    progress: Progress = options.get("progress", silent)
    failed = Event()

    def report(stage: str, done: int, total: int, note: str = "") -> None:
        if failed.is_set():
            raise CancelledError
        progress(stage, done, total, note)

    with ThreadPoolExecutor(max_workers=1) as pool:
        started = pool.submit(solve, task, **{**options, "progress": report})
        try:
            guided = solve(replace(task, guess=guide(task, **options).vertices), **options)
            plain = started.result()
        except BaseException:
            failed.set()
            raise
    lower = plain.extra["energy"] < CLEARLY_LOWER * guided.extra["energy"]
    facts["initialisation"] = "handles" if lower else "guide"
    return plain if lower else guided
