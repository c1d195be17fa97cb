"""Drags of a bound mesh to time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from time import perf_counter
from typing import Any

import numpy as np

from eval.bench.cases import TimedMethod, deformation, moved
from eval.metrics import Task
from eval.rows.store import Row
from eval.run.targets import locate
from sshade.core.errors import InputError
from sshade.method.bound import Deformer
from sshade.method.call import deform
from sshade.problem.options import accepted
from sshade.problem.task import DeformationTask

#: Number of steps of a drag from rest to the targets, and residual at which each step stops.
STEPS, TOLERANCE = 60, 1e-4


def drag_of(method: TimedMethod, task: Task) -> Callable[[], Row]:
    """Return the drag of a method that :class:`sshade.Deformer` binds; each drag has a new mesh."""
    options, numbers = deformer_options(method), count(1)
    return lambda: drag(deformation(moved(task, next(numbers))), options)


def deformer_options(method: TimedMethod) -> dict[str, Any]:
    """Return the options of :class:`sshade.Deformer` from the configuration of a method that it binds."""
    label, config, name = method.label, method.config, method.config.get("method")
    if locate(config["_target_"]) is not deform or name not in ("fast", "paper"):
        raise InputError(f"{label} cannot be bound: sshade.Deformer binds the methods paper and fast")
    if config["proxy_method"] is not None:
        raise InputError(f"{label} cannot be bound: sshade.Deformer has its own solver of proxies")
    names = set(accepted(name)) - {"proxy_method"}
    return {"method": name, **{key: value for key, value in config.items() if key in names}}


def bound(task: DeformationTask, options: dict[str, Any]) -> Deformer:
    """Bind the mesh and the handles of a task."""
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
    handles, rest = task.handles, task.mesh.V[task.handles.index]
    begin = perf_counter()
    deformer = bound(task, options)
    ready = perf_counter()
    first = deformer.step(handles.target)
    solved = perf_counter()
    minimum = deformer.settle().vertices
    deformer.reset()
    before = deformer.step(rest, tolerance=TOLERANCE).vertices
    out = np.empty_like(before)
    path = [rest + number / STEPS * (handles.target - rest) for number in range(STEPS + 1)]
    forth = _timed_steps(deformer, path[1:], out)
    last = out.copy()
    start = perf_counter()
    deformer.settle(out=out)
    settling = perf_counter() - start
    settled = out.copy()
    _timed_steps(deformer, path[-2::-1], out)
    whole, solve, carry = np.median(forth, axis=0)
    seconds = {
        "bind": ready - begin,
        "first": solved - ready,
        "step": whole,
        "step_95": np.percentile(forth[:, 0], 95),
        "step_solve": solve,
        "step_carry": carry,
        "step_output": np.median(forth[:, 0] - forth[:, 1] - forth[:, 2]),
        "settle": settling,
        "rebind": _rebinding(deformer, task),
        "total": perf_counter() - begin,
    }
    shapes = {
        "first": (first.vertices, minimum),
        "last": (last, first.vertices),
        "settled": (settled, minimum),
        "return": (out, before),
    }
    row = {f"seconds.{name}": float(value) for name, value in seconds.items()}
    row["iterations"] = float(first.iterations)
    for name, (one, other) in shapes.items():
        row[f"drag.{name}"] = 100 * float(np.linalg.norm(one - other, axis=1).max()) / task.mesh.diagonal
    return row


def _timed_steps(deformer: Deformer, path: Sequence[np.ndarray], out: np.ndarray) -> np.ndarray:
    """Follow targets (h, 3); return the seconds (k, 3) of each step, of its solve and of its prolongation."""
    seconds = []
    for targets in path:
        begin = perf_counter()
        parts = deformer.step(targets, tolerance=TOLERANCE, out=out).seconds
        seconds.append((perf_counter() - begin, parts["solve"], parts["carry"]))
    return np.array(seconds)


def _rebinding(deformer: Deformer, task: DeformationTask) -> float:
    """Return the mean seconds of removing the last group of handles, if there are several, and adding it."""
    handles = task.handles
    fewer = handles.group != handles.group.max()
    begin = perf_counter()
    for kept in (fewer if fewer.any() else ~fewer, np.ones(len(handles), dtype=bool)):
        deformer.rebind(handles.index[kept], group=handles.group[kept], weight=handles.weight[kept])
    return (perf_counter() - begin) / 2
