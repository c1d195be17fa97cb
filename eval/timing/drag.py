"""A mesh that is bound once and follows its handles: bind, first solve, steps of a drag, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from eval.rows.store import Row
from eval.run.targets import instantiate
from eval.timing.cases import TimedMethod, task_facts
from eval.timing.scaling import nearest, subdivided
from eval.timing.turns import Job, take_turns
from sshade.errors import InputError
from sshade.options import PROXIES, SOLVER
from sshade.pipeline.deformer import Deformer
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.paper import sshade
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
    methods: Sequence[TimedMethod],
    sources: Sequence[dict[str, Any]],
    *,
    rounds: int,
    sizes: Sequence[int] = (),
) -> list[Row]:
    """Time drags of methods on tasks in turns.

    Parameters
    ----------
    methods : sequence of TimedMethod
    sources : sequence of dict
        Configurations that load the tasks.
    rounds : int
    sizes : sequence of int
        Numbers of vertices: for each the midpoint subdivision of a task that comes nearest, in place of all
        tasks as they are.

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`; and when a method cannot be bound.
    """
    tasks = [instantiate(source) for source in sources]
    if sizes:
        near = nearest([task.mesh.n for task in tasks], sizes)
        tasks = [subdivided(tasks[base], level) if level else tasks[base] for _, base, level in near]
    return take_turns([_job(method, task) for task in tasks for method in methods], rounds=rounds)


def _job(method: TimedMethod, task: DeformationTask) -> Job:
    call = method.on(task)
    if not isinstance(task, DeformationTask) or call.func not in (sshade, sshade_fast):
        raise InputError(
            f"{method.label} on {task.name} cannot be bound: sshade.Deformer binds sshade and sshade_fast"
        )
    taken = (*PROXIES, *SOLVER) if call.func is sshade_fast else PROXIES
    options = {name: method.config[name] for name in taken if name in method.config}
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
    """Bind, solve, drag the handles from rest to their targets and back, and change them.

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
        steps to the targets, of which ``seconds.step_solve`` the proxy takes, ``seconds.step_carry`` the
        mesh and ``seconds.step_output`` the rest, medians too; ``seconds.settle``, from the last step to the
        minimum; ``seconds.rebind``, the mean of leaving the last group of handles out and of taking it again.
        Distances of the farthest vertex, % of the diagonal: ``drag.first``, of the first solve from the
        minimum that it leads to; ``drag.last``, of the last step from the first solve; ``drag.settled``, of
        where the drag settles from where the first solve does; ``drag.return``, of the way back from before.
    """
    rest, target = task.mesh.V[task.handles.index], task.handles.target

    def apart(one: np.ndarray, other: np.ndarray) -> float:
        return 100 * float(np.linalg.norm(one - other, axis=1).max()) / task.mesh.diagonal

    begin = perf_counter()
    deformer = _bound(task, options)
    bound = perf_counter()
    first = deformer(target)
    solved = perf_counter()
    minimum = deformer.settle().vertices
    deformer.reset()
    before = deformer(rest, tolerance=TOLERANCE).vertices
    steps, out = [], np.empty_like(before)

    def step(number: int) -> None:
        start = perf_counter()
        result = deformer(rest + number / STEPS * (target - rest), tolerance=TOLERANCE, out=out)
        steps.append((perf_counter() - start, result.seconds["solve"], result.seconds["carry"]))

    for number in range(1, STEPS + 1):
        step(number)
    last, there = out.copy(), np.array(steps)
    start = perf_counter()
    settled = deformer.settle(out=out).vertices
    settling = perf_counter() - start
    facts = {
        "drag.first": apart(first.vertices, minimum),
        "drag.last": apart(last, first.vertices),
        "drag.settled": apart(settled, minimum),
    }
    for number in range(STEPS - 1, -1, -1):
        step(number)
    whole, solve, carry = np.median(there, axis=0)
    return {
        "seconds.bind": bound - begin,
        "seconds.first": solved - bound,
        "seconds.step": float(whole),
        "seconds.step_95": float(np.percentile(there[:, 0], 95)),
        "seconds.step_solve": float(solve),
        "seconds.step_carry": float(carry),
        "seconds.step_output": float(np.median(there[:, 0] - there[:, 1] - there[:, 2])),
        "seconds.settle": settling,
        "seconds.rebind": _rebinding(deformer, task),
        "seconds.total": perf_counter() - begin,
        "iterations": float(first.iterations),
        **facts,
        "drag.return": apart(out, before),
    }


def _rebinding(deformer: Deformer, task: DeformationTask) -> float:
    """Seconds of a change of handles: the last group is left out, where there are others, and comes back."""
    own = task.handles
    fewer = own.group != own.group.max()
    begin = perf_counter()
    for taken in (fewer if fewer.any() else ~fewer, np.ones(len(own), dtype=bool)):
        deformer.rebind_handles(own.index[taken], group=own.group[taken], weight=own.weight[taken])
    return (perf_counter() - begin) / 2
