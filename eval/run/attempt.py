"""Call a method on a task in this process, and time the call."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np

from eval import EXTRAS
from eval.metrics import Task
from eval.rows.store import Row, is_scalar, plain, printable
from eval.run.targets import flat, instantiate, is_ours, require_kind
from eval.run.warmup import warm_up
from sshade.core.console import Ended, arrived_in, missing_library
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.facts import Facts
from sshade.problem.task import DeformationResult, result_of

log = logging.getLogger(__name__)

#: Facts of a method without a result.
NOTHING: Row = {"status": "failed", "reason": "", "iterations": None, "converged": None}

#: Stages that the evaluator measures itself, and columns that say which method ran. A method sets neither.
CLOCKED = ("total", "cpu")
IDENTITY = ("name", "_target_", "target", "hash", "version", "note")

#: Variable with the time limit of a run in seconds, for methods that run programs; missing without a limit.
TIME_LIMIT = "EVAL_TIME_LIMIT"


class Attempt(NamedTuple):
    """Result of a run.

    Attributes
    ----------
    facts : dict
        status, reason, iterations, converged, seconds.*, extra.*, env.warmed_up, env.cores_used, and
        ``method.*`` for the options that the method resolved (``extra["options"]`` of its result).
    vertices : (n, 3) float64 or None
        None if the method failed.
    """

    facts: Row
    vertices: np.ndarray | None = None


class Misconfigured(InputError):
    """A mistake in the configuration of a method."""


class BadResult(Exception):
    """A method told a fact that no row can hold, or a fact that the evaluator measures."""


def attempt(method: Mapping[str, Any], task: Task, *, seed: int, progress: Progress = silent) -> Attempt:
    """Run a method in this process. Its exception or exit becomes the status and reason of the row.

    Parameters
    ----------
    method : mapping
        Configuration of the method: ``_target_``, parameters, ``warm_up``.
    task : DeformationTask or TransferTask
    seed : int
    progress : Progress

    Raises
    ------
    InputError
        When the configuration names an unknown function or parameter, or a method for another kind of task.
    """
    return attempt_task(method, type(task), lambda: task, seed=seed, progress=progress)


def attempt_task(
    method: Mapping[str, Any],
    kind: type[Task],
    receive: Callable[[], Task],
    *,
    seed: int,
    time_limit: float | None = None,
    progress: Progress,
) -> Attempt:
    """Run a method on a task of a kind, which `receive` returns after the warm-up.

    The variable :data:`TIME_LIMIT` tells the method its limit. The method may end itself with a TimeoutError.
    """
    row = NOTHING | warmed_up(method)
    try:
        call = _bound(method, kind)
        if row["env.warmed_up"]:
            progress("warm-up", 0, 1)
            warm_up(method, kind=kind)
            progress("warm-up", 1, 1)
        task = receive()
        with _told(time_limit):
            begin, cpu = perf_counter(), _cpu_seconds()
            result = result_of(task, call(task, seed=seed, progress=progress))
            vertices = np.array(result.vertices)  # a copy, which a thread of the method does not know
            times = times_of(perf_counter() - begin, _cpu_seconds() - cpu)
        return Attempt(row | facts_of(result, ours=is_ours(method)) | times, vertices)
    except ImportError as error:
        return Attempt(row | {"status": "skipped", "reason": reason_of(error)})
    except (Ended, Misconfigured):
        raise
    except BadResult as error:
        return Attempt(row | {"reason": printable(str(error))})
    except (Exception, SystemExit) as error:  # a method may raise anything; the sweep continues
        if isinstance(signalled := arrived_in(error), KeyboardInterrupt | Ended):
            raise signalled from None
        log.debug("%s", method["_target_"], exc_info=True)
        late = isinstance(error, TimeoutError) and time_limit is not None
        if late:
            return Attempt(row | {"status": "timeout", "reason": printable(str(error))})
        return Attempt(row | {"reason": reason_of(error)})


def warmed_up(method: Mapping[str, Any]) -> Row:
    """Return the column that says whether a method has a warm-up."""
    return {"env.warmed_up": method.get("warm_up", {}) is not None}


def _bound(method: Mapping[str, Any], kind: type[Task]) -> Callable[..., DeformationResult]:
    """Return the function of a method with its parameters."""
    try:
        call = instantiate({**method, "_partial_": True})
        require_kind(call, kind, target=method["_target_"])
    except InputError as error:
        raise Misconfigured(str(error)) from error
    return call


@contextmanager
def _told(time_limit: float | None) -> Iterator[None]:
    """Tell a method its time limit; the programs that it runs inherit the variable."""
    if time_limit is None:
        yield
        return
    os.environ[TIME_LIMIT] = repr(time_limit)
    try:
        yield
    finally:
        del os.environ[TIME_LIMIT]


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of its finished child processes."""
    ended = os.times()
    return process_time() + ended.children_user + ended.children_system


def times_of(seconds: float, cpu: float) -> Row:
    return {"seconds.total": seconds, "seconds.cpu": cpu, "env.cores_used": round(cpu / seconds, 3)}


def facts_of(result: DeformationResult, *, ours: bool) -> Row:
    """Return the columns of what a method tells.

    Raises
    ------
    BadResult
        On a fact that a row cannot hold, or that the evaluator measures.
    """
    if not isinstance(result.converged, (bool, np.bool_, type(None))):
        raise BadResult(f"the method's converged is {result.converged!r}; it takes True, False or None")
    converged = None if result.converged is None else bool(result.converged)
    row: Row = {"status": "not_converged" if converged is False else "ok", "converged": converged}
    row["iterations"] = _number("iterations", result.iterations)
    for stage, value in result.seconds.items():
        if stage in CLOCKED:
            raise BadResult(f"the method tells seconds[{stage!r}], which the evaluator measures")
        row[f"seconds.{stage}"] = _number(f"seconds[{stage!r}]", value)
    found = {**(vars(result.facts) if result.facts != Facts() else {}), **result.extra}
    options = found.pop("options", {})
    if not isinstance(options, Mapping):
        raise BadResult(
            f"the method's extra['options'] is of type {type(options).__name__}; it takes a mapping"
        )
    if claimed := [name for name in IDENTITY if name in options]:
        raise BadResult(f"the method's extra['options'] has {claimed[0]!r}, which the evaluator writes")
    if "peak_mib" in found:
        if not ours:
            raise BadResult("the method tells extra['peak_mib'], which the evaluator measures")
        row["peak_mib"] = found.pop("peak_mib")  # of the program that the method ran
    told = flat({name: value for name, value in options.items() if name != "seed"}, "method")
    told |= {f"extra.{name}": _finite(value) for name, value in found.items()}
    return row | {name: plain(value) for name, value in told.items() if is_scalar(value)}


def _number(name: str, value: Any) -> float:
    """Return a number that a method tells; raise BadResult unless it is finite and not negative."""
    try:
        number = math.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not 0 <= number < math.inf:
        raise BadResult(f"the method's {name} is {value!r}; it takes a number from 0 on")
    return number


def _finite(value: Any) -> Any:
    """Return a value, None for an infinite number."""
    return None if isinstance(value, (float, np.floating)) and not np.isfinite(value) else value


def reason_of(error: BaseException) -> str:
    """Return the type and the message of an error in one line."""
    text = printable(" ".join((missing_library(error, EXTRAS) or str(error)).split()))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
