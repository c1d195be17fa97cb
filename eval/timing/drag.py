"""Time drags of a bound mesh: bind, first solve, steps, and the way back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from time import perf_counter
from typing import Any

import numpy as np

from eval.rows.store import Row
from eval.run.provenance import method_facts, task_facts
from eval.run.targets import locate
from eval.timing.timed_cases import TimedCase, TimedMethod
from eval.timing.turns import Job, take_turns
from sshade.core.errors import InputError
from sshade.method.call import deform
from sshade.method.deformer import Deformer
from sshade.problem.options import accepted
from sshade.problem.task import DeformationTask

#: Number of steps of a drag from rest to the targets.
STEPS = 60
#: Residual at which each step stops.
TOLERANCE = 1e-4
#: Largest accepted distance between the results of the bound mesh and of the method, as a fraction of the
#: bounding-box diagonal.
SAME = 1e-6


def time_drags(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time drags of methods on tasks, in turns.

    Raises
    ------
    InputError
        As :func:`eval.timing.turns.take_turns`; and if a method cannot be bound.
    """
    tasks = [case.load() for case in cases]
    return take_turns([_job(method, task) for task in tasks for method in methods], rounds=rounds)


def _job(method: TimedMethod, task: DeformationTask) -> Job:
    call, name = method.on(task), method.config.get("method")
    if locate(method.config["_target_"]) is not deform or name not in ("fast", "paper"):
        raise InputError(f"{method.label} cannot be bound: sshade.Deformer binds the methods paper and fast")
    names = set(accepted(name)) - {"coarse", "warm_start"}
    options = {"method": name, **{key: value for key, value in method.config.items() if key in names}}
    bound = _bound(task, options)(task.handles.target, rotations=task.handles.rotation)
    apart = np.linalg.norm(bound.vertices - call().vertices, axis=1).max() / task.mesh.diagonal
    if apart > SAME:
        raise InputError(
            f"{method.label} on {task.name} cannot be bound: results of the method and of sshade.Deformer "
            f"differ by {apart:.2g} of the diagonal; the Deformer solves proxies by its own solver, so leave "
            "method@method.coarse out"
        )
    facts = method_facts(method.label, method.config) | task_facts(task)
    return Job(facts, lambda: drag(task, options))


def _bound(task: DeformationTask, options: dict[str, Any]) -> Deformer:
    handles = task.handles
    return Deformer(task.mesh, handles.index, group=handles.group, weight=handles.weight, **options)


def drag(task: DeformationTask, options: dict[str, Any]) -> Row:
    """Bind, solve, drag the handles from rest to their targets and back, and change the handles.

    Parameters
    ----------
    task : DeformationTask
    options : dict
        Arguments of :class:`sshade.Deformer` other than the handles.

    Returns
    -------
    dict
        Times in seconds:

        - ``seconds.bind``; ``seconds.first``: from rest to the targets at once, to the default tolerance;
        - ``seconds.step``, ``seconds.step_95``: median and 95th percentile of the steps to the targets;
        - ``seconds.step_solve``, ``seconds.step_carry``, ``seconds.step_output``: medians of the time of
          the proxy, of the mesh and of the rest of a step;
        - ``seconds.settle``: from the last step to the minimum;
        - ``seconds.rebind``: mean of removing the last group of handles and of adding it again.

        Largest distance of a vertex between two shapes, in % of the diagonal:

        - ``drag.first``: the first solve and its minimum;
        - ``drag.last``: the last step and the first solve;
        - ``drag.settled``: the minimum after the drag and the minimum of the first solve;
        - ``drag.return``: the end of the way back and the solution at rest.
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
    out = np.empty_like(before)

    def follow(numbers: range) -> np.ndarray:
        path = (rest + number / STEPS * (target - rest) for number in numbers)
        return _timed_steps(deformer, path, out)

    forth = follow(range(1, STEPS + 1))
    last = out.copy()
    start = perf_counter()
    settled = deformer.settle(out=out).vertices
    settling = perf_counter() - start
    distances = {
        "drag.first": apart(first.vertices, minimum),
        "drag.last": apart(last, first.vertices),
        "drag.settled": apart(settled, minimum),
    }
    follow(range(STEPS - 1, -1, -1))
    whole, solve, carry = np.median(forth, axis=0)
    return {
        "seconds.bind": bound - begin,
        "seconds.first": solved - bound,
        "seconds.step": float(whole),
        "seconds.step_95": float(np.percentile(forth[:, 0], 95)),
        "seconds.step_solve": float(solve),
        "seconds.step_carry": float(carry),
        "seconds.step_output": float(np.median(forth[:, 0] - forth[:, 1] - forth[:, 2])),
        "seconds.settle": settling,
        "seconds.rebind": _rebinding(deformer, task),
        "seconds.total": perf_counter() - begin,
        "iterations": float(first.iterations),
        **distances,
        "drag.return": apart(out, before),
    }


def _timed_steps(deformer: Deformer, path: Iterable[np.ndarray], out: np.ndarray) -> np.ndarray:
    """Follow targets (h, 3); return the seconds (k, 3) of each step, of its solve and of its prolongation."""
    seconds = []
    for targets in path:
        begin = perf_counter()
        parts = deformer(targets, tolerance=TOLERANCE, out=out).seconds
        seconds.append((perf_counter() - begin, parts["solve"], parts["carry"]))
    return np.array(seconds)


def _rebinding(deformer: Deformer, task: DeformationTask) -> float:
    """Return the mean seconds of removing the last group of handles, if there are several, and adding it."""
    handles = task.handles
    fewer = handles.group != handles.group.max()
    begin = perf_counter()
    for kept in (fewer if fewer.any() else ~fewer, np.ones(len(handles), dtype=bool)):
        deformer.rebind_handles(handles.index[kept], group=handles.group[kept], weight=handles.weight[kept])
    return (perf_counter() - begin) / 2
