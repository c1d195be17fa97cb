"""A method on a task: the timed call, here or in a process of its own.

A fresh process is what gives a peak of memory that means something, and what
can be stopped at a time limit.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import resource
import sys
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from eval.provenance import process_memory
from eval.store import Row
from eval.targets import instantiate, settings
from eval.truth import Task
from eval.warmup import warm_up
from sshade.task import DeformationResult, Progress, silent

log = logging.getLogger(__name__)

#: Arrays of a result's `extra` whose name ends so hold a line a step, and are kept with the run.
CURVE = "_curve"


class Attempt(NamedTuple):
    """What a run gave.

    Attributes
    ----------
    facts : dict
        status, reason, iterations, converged, seconds.*, extra.*, env.warmed_up.
    vertices : (n, 3) float64 or None
        None where the method failed.
    curves : dict
        Arrays of a line a step, such as losses, by name.
    """

    facts: Row
    vertices: np.ndarray | None = None
    curves: Mapping[str, np.ndarray] = MappingProxyType({})


def attempt(
    method: Mapping[str, Any],
    task: Task,
    *,
    seed: int,
    progress: Progress = silent,
    before_clock: Callable[[], None] = lambda: None,
) -> Attempt:
    """Run a method; whatever it raises becomes the row's status and reason.

    Parameters
    ----------
    method : mapping
        Its configuration: ``_target_``, parameters, ``warm_up``.
    task : DeformationTask or TransferTask
    seed : int
    progress : Progress
    before_clock : callable
        Called after the warm-up.
    """
    row: Row = {"status": "failed", "reason": "", "iterations": None, "converged": None}
    row["env.warmed_up"] = method.get("warm_up", {}) is not None
    try:
        call = instantiate({**method, "_partial_": True})
        if row["env.warmed_up"]:
            warm_up(call, dict(method.get("warm_up", {})), key=repr(settings(method)), kind=type(task))
        before_clock()
        begin = perf_counter()
        result = call(task, seed=seed, progress=progress)
        seconds = perf_counter() - begin
        if np.shape(result.vertices) != task.mesh.V.shape:
            raise ValueError(f"vertices of shape {np.shape(result.vertices)} for {task.mesh.V.shape}")
    except ImportError as error:
        return Attempt(row | {"status": "skipped", "reason": _sentence(error)})
    except Exception as error:  # whatever a method raises belongs into its row; the sweep goes on
        log.debug("%s on %s", method["_target_"], task.name, exc_info=True)
        return Attempt(row | {"reason": _sentence(error)})
    return Attempt(row | _facts(result, seconds), result.vertices, _curves(result))


def attempt_fresh(method: Mapping[str, Any], task: Task, *, seed: int, time_limit: float | None) -> Attempt:
    """:func:`attempt` in a process of its own, with ``peak_mib`` and at most `time_limit` seconds of clock.

    The limit counts from the end of the warm-up. The peak is that of the whole
    process: libraries, warm-up and the method.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_child, args=(theirs, method, task, seed), daemon=False)
    process.start()
    theirs.close()
    row: Row = {"status": "failed", "reason": "", "iterations": None, "converged": None}
    try:
        answer = ours.recv()
        if answer == "clock":
            if not ours.poll(time_limit):
                return Attempt(row | {"status": "timeout", "reason": f"no result within {time_limit:g} s"})
            answer = ours.recv()
        return answer
    except EOFError:
        process.join()
        return Attempt(row | {"reason": f"the process ended with exit code {process.exitcode}"})
    finally:
        process.kill()
        process.join()
        ours.close()


def _child(connection: Connection, method: Mapping[str, Any], task: Task, seed: int) -> None:
    done = attempt(method, task, seed=seed, before_clock=lambda: connection.send("clock"))
    connection.send(done._replace(facts=done.facts | {"peak_mib": _peak_mib()}, curves=dict(done.curves)))


def _peak_mib() -> float:
    """High-water mark of this process's memory in MiB."""
    # On Linux ru_maxrss starts at the parent's peak, which exec hands down; VmHWM does not.
    high_water = process_memory("VmHWM")
    if high_water is not None:
        return high_water / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _facts(result: DeformationResult, seconds: float) -> Row:
    row: Row = {
        "status": "not_converged" if result.converged is False else "ok",
        "iterations": float(result.iterations),
        "converged": None if result.converged is None else bool(result.converged),
        "seconds.total": seconds,
    }
    row |= {f"seconds.{stage}": float(value) for stage, value in result.seconds.items() if stage != "total"}
    row |= {f"extra.{name}": _plain(value) for name, value in result.extra.items() if is_scalar(value)}
    return row


def _curves(result: DeformationResult) -> dict[str, np.ndarray]:
    return {name: np.asarray(value) for name, value in result.extra.items() if name.endswith(CURVE)}


def is_scalar(value: Any) -> bool:
    """Whether a fact fits into a row."""
    return value is None or isinstance(value, (bool, int, float, str, np.generic))


def _plain(value: Any) -> Any:
    """A Python scalar that JSON knows: no numpy types, None for NaN and infinities."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _sentence(error: BaseException) -> str:
    """The error on one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
