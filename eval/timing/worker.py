"""A program that deforms cases with any version of this project: ``python -P worker.py``.

Each line of the input is a request in JSON, and each line of the output is its answer. The program uses only
names of :mod:`sshade` that all versions have, and imports nothing from :mod:`eval`: the folder of the version
comes first in ``PYTHONPATH``.

- ``{"load": FILE, "name": NAME, "index": [...], "target": [...], "group": [...]}`` reads a mesh file.
- ``{"name": NAME, "method": METHOD}`` deforms. With ``"drag": STEPS`` and ``"tolerance"`` it drags from rest
  to the targets.

The answers hold the seconds.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from time import perf_counter
from typing import Any

import numpy as np

from sshade import DeformationTask, Deformer, Handles, Mesh, deform, read


def load(request: dict[str, Any]) -> DeformationTask:
    """Read a case."""
    given = {name: np.array(request[name]) for name in ("index", "target", "group")}
    handles = Handles(**given)
    return DeformationTask(request["name"], Mesh(*read(request["load"])), handles)


def timed_deform(task: DeformationTask, method: str) -> dict[str, Any]:
    """Deform a task; return the seconds and the number of iterations."""
    begin = perf_counter()
    result = deform(task, method=method)
    return {"seconds.total": perf_counter() - begin, "iterations": float(result.iterations)}


def timed_steps(
    deformer: Deformer, path: Iterable[np.ndarray], tolerance: float, out: np.ndarray
) -> np.ndarray:
    """Follow targets (h, 3); return the seconds (k, 3) of each step, of its solve and of its prolongation."""
    seconds = []
    for targets in path:
        begin = perf_counter()
        parts = deformer(targets, tolerance=tolerance, out=out).seconds
        seconds.append((perf_counter() - begin, parts["solve"], parts["carry"]))
    return np.array(seconds)


def timed_drag(task: DeformationTask, method: str, steps: int, tolerance: float) -> dict[str, Any]:
    """Drag from rest to the targets; return the median seconds of a step and of its parts."""
    handles, out = task.handles, np.empty_like(task.mesh.V)
    rest = task.mesh.V[handles.index]
    deformer = Deformer(task.mesh, handles.index, group=handles.group, method=method)
    deformer(rest, tolerance=tolerance, out=out)
    path = (rest + number / steps * (handles.target - rest) for number in range(1, steps + 1))
    whole, solve, carry = np.median(timed_steps(deformer, path, tolerance, out), axis=0)
    return {"seconds.total": whole, "seconds.step_solve": solve, "seconds.step_carry": carry}


def main() -> None:
    """Answer requests until the input ends."""
    tasks: dict[str, DeformationTask] = {}
    for line in sys.stdin:
        request = json.loads(line)
        name, answer = request["name"], dict[str, Any]()
        if "load" in request:
            tasks[name] = load(request)
        elif "drag" in request:
            answer = timed_drag(tasks[name], request["method"], request["drag"], request["tolerance"])
        else:
            answer = timed_deform(tasks[name], request["method"])
        print(json.dumps(answer), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
