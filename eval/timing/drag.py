"""A mesh that is bound once and follows its handles: bind, first solve, steps of a drag, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from eval.rows.store import Row
from eval.run.targets import instantiate
from eval.timing.cases import TimedMethod, task_facts
from eval.timing.turns import Job, take_turns
from sshade.errors import InputError
from sshade.pipeline.deformer import Deformer
from sshade.pipeline.fast import FastOptions, sshade_fast
from sshade.pipeline.paper import sshade
from sshade.pipeline.proxies import ProxyOptions
from sshade.task import DeformationTask

#: What these rows are of.
KIND = "drag"
#: Steps of a drag from rest to the targets.
STEPS = 60
#: Residual at which each of them stops.
TOLERANCE = 1e-4
#: Largest distance, over the diagonal, between what a bound mesh gives and what its method gives.
SAME = 1e-6


def time_drags(
    methods: Sequence[TimedMethod], sources: Sequence[dict[str, Any]], *, rounds: int
) -> list[Row]:
    """Time drags of methods on tasks in turns.

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`; and when a method cannot be bound.
    """
    tasks = [instantiate(source) for source in sources]
    return take_turns([_job(method, task) for task in tasks for method in methods], rounds=rounds)


def _job(method: TimedMethod, task: DeformationTask) -> Job:
    call = method.on(task)
    if not isinstance(task, DeformationTask) or call.func not in (sshade, sshade_fast):
        raise InputError(
            f"{method.label} on {task.name} cannot be bound: sshade.Deformer binds sshade and sshade_fast"
        )
    taken = FastOptions if call.func is sshade_fast else ProxyOptions
    options = {name: method.config[name] for name in taken.__annotations__ if name in method.config}
    options["method"] = "fast" if call.func is sshade_fast else "paper"
    bound = _bound(task, options)(task.handles.target, rotations=task.handles.rotation)
    apart = np.linalg.norm(bound.vertices - call().vertices, axis=1).max() / task.mesh.diagonal
    if apart > SAME:
        raise InputError(
            f"{method.label} on {task.name} cannot be bound: sshade.Deformer gives another shape, "
            f"{apart:.2g} of the diagonal apart, as it begins at rest and solves proxies with its own "
            "settings; with solver.start=rest and no settings of the proxy they are one"
        )
    facts = {"kind": KIND} | method.facts | task_facts(task)
    return Job(facts, lambda: drag(task, options))


def _bound(task: DeformationTask, options: dict[str, Any]) -> Deformer:
    own = task.handles
    return Deformer(task.mesh, own.index, group=own.group, weight=own.weight, **options)


def drag(task: DeformationTask, options: dict[str, Any]) -> Row:
    """Bind, solve, and drag the handles from rest to their targets and back.

    Parameters
    ----------
    task : DeformationTask
    options : dict
        Of :class:`sshade.Deformer`, besides the handles.

    Returns
    -------
    dict
        ``seconds.bind``, ``seconds.first`` (from rest to the targets at once, to the default
        tolerance), ``seconds.step`` and ``seconds.step_95``, the median and the 95th percentile of the
        steps to the targets; ``drag.return``, the largest distance of a vertex after the way back from
        where it was before, % of the diagonal.
    """
    rest, target = task.mesh.V[task.handles.index], task.handles.target
    begin = perf_counter()
    deformer = _bound(task, options)
    bound = perf_counter()
    first = deformer(target)
    solved = perf_counter()
    deformer.reset()
    before = deformer(rest, tolerance=TOLERANCE).vertices
    seconds, after = [], np.empty_like(before)
    for step in [*range(1, STEPS + 1), *range(STEPS - 1, -1, -1)]:
        targets = rest + step / STEPS * (target - rest)
        start = perf_counter()
        deformer(targets, tolerance=TOLERANCE, out=after)
        seconds.append(perf_counter() - start)
    there = seconds[:STEPS]
    apart = np.linalg.norm(after - before, axis=1).max() / task.mesh.diagonal
    return {
        "seconds.bind": bound - begin,
        "seconds.first": solved - bound,
        "seconds.step": float(np.median(there)),
        "seconds.step_95": float(np.percentile(there, 95)),
        "seconds.total": perf_counter() - begin,
        "iterations": float(first.iterations),
        "drag.return": 100 * float(apart),
    }
