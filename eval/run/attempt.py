"""Call a method on a task and time the call, in this process or in a new one.

Only a new process has a meaningful peak of memory, and only a new process can be stopped at a time limit.
Methods of others run in new processes, so that they change neither measures nor clocks nor other runs.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from threading import Lock, Thread
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
import psutil

from eval import EXTRAS
from eval.metrics import Task
from eval.rows.store import Row, is_scalar, plain, printable
from eval.run.environment import process_memory
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

#: Message from a new process after the warm-up: it waits for the task.
READY = "ready"

#: Variable with the time limit of a run in seconds, for methods that run programs; missing without a limit.
TIME_LIMIT = "EVAL_TIME_LIMIT"

#: Least time limit in seconds for imports, compilation and warm-up, in runs with a time limit.
WARM_UP_LIMIT = 60.0

#: Seconds after the time limit in which a method that runs a program may tell the last words of the program.
LAST_WORDS = 1.0

#: Seconds between two looks whether a process without an answer still runs.
ALIVE_PERIOD = 1.0

#: Shortest time in seconds between two progress messages of one stage from a new process.
PROGRESS_PERIOD = 0.2


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
    return _attempt(method, type(task), lambda: task, seed=seed, progress=progress)


def _attempt(
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
    row = NOTHING | {"env.warmed_up": method.get("warm_up", {}) is not None}
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
            times = _times(perf_counter() - begin, _cpu_seconds() - cpu)
        return Attempt(row | _facts(result, ours=is_ours(method)) | times, vertices)
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


def _bound(method: Mapping[str, Any], kind: type[Task]) -> Callable[..., DeformationResult]:
    """Return the function of a method with its parameters."""
    try:
        call = instantiate({**method, "_partial_": True})
        require_kind(call, kind, target=method["_target_"])
    except InputError as error:
        raise Misconfigured(str(error)) from error
    return call


def attempt_fresh(
    method: Mapping[str, Any], task: Task, *, seed: int, time_limit: float | None, progress: Progress = silent
) -> Attempt:
    """Run a method as :func:`attempt` does, in a new process, which also measures ``peak_mib``.

    The process gets the task after the warm-up. The clock of this process, which no method can change, runs
    from then until the result is here; sending 170,000 vertices takes about 0.01 s. The warm-up has the same
    limit, at least :data:`WARM_UP_LIMIT`; the `time_limit` starts after it. The peak of memory includes
    libraries, the warm-up and the method.
    """
    # A worker of joblib has a start method that is unknown in a child process.
    method_of_start = multiprocessing.get_start_method(allow_none=True)
    if method_of_start not in (None, *multiprocessing.get_all_start_methods()):
        multiprocessing.set_start_method("spawn", force=True)
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    given = theirs, progress is not silent, log.getEffectiveLevel()
    process = context.Process(target=_child, args=given, daemon=False)
    try:
        with _no_interrupts() if os.name == "posix" else nullcontext():
            process.start()
        theirs.close()
        # Arguments of the process could block `start` for ever if the process ended before reading them.
        ours.send((method, type(task), seed, time_limit))
        return _answer(ours, psutil.Process(process.pid), task, time_limit, progress)
    except (EOFError, ConnectionError):
        process.join()
        assert process.exitcode is not None, "the process was joined"
        return Attempt(NOTHING | {"reason": _end(process.exitcode)})
    finally:
        if process.pid is not None:
            process.kill()
            process.join()
        ours.close()


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Block Ctrl-C here and in processes that start meanwhile; this process ends them."""
    # Otherwise the start of a process starts the tracker, which unblocks the signals.
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _answer(
    connection: Connection,
    child: psutil.Process,
    task: Task,
    time_limit: float | None,
    progress: Progress,
) -> Attempt:
    """Send the task when the process waits for it, and pass on progress; return its result, or the timeout.

    Raises
    ------
    EOFError
        When the process has ended without an answer.
    """
    stage, limit = "the warm-up did not end", max(WARM_UP_LIMIT, time_limit or 0.0)
    begin, cpu = perf_counter(), 0.0
    while True:
        left = max(0.0, begin + limit - perf_counter()) if time_limit is not None else ALIVE_PERIOD
        if not connection.poll(min(left, ALIVE_PERIOD)):
            # A process that the child has started may keep the connection open.
            if _has_ended(child) and not connection.poll():
                raise EOFError
            if left == 0.0:
                break
            continue
        message = connection.recv()
        if isinstance(message, Misconfigured):
            raise message
        if isinstance(message, Attempt):
            if message.vertices is None:
                return message
            times = _times(perf_counter() - begin, _cpu_seconds_of(child) - cpu)
            if time_limit is None or times["seconds.total"] <= time_limit:
                return message._replace(facts=message.facts | times)
            break
        if message != READY:
            progress(*message)
        elif stage != "no result":  # a method cannot set the clock back
            connection.send(task)
            stage, limit = "no result", (time_limit or 0.0) + LAST_WORDS
            begin, cpu = perf_counter(), _cpu_seconds_of(child)
    assert time_limit is not None, "without a limit, a message ends the loop"
    limit = time_limit if stage == "no result" else limit
    return Attempt(NOTHING | {"status": "timeout", "reason": f"{stage} within {limit:g} s"})


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


def _has_ended(process: psutil.Process) -> bool:
    """Whether a child process has ended; its state stays readable until it is joined."""
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def _cpu_seconds_of(process: psutil.Process) -> float:
    """Return the CPU time of a process and of its finished child processes."""
    return sum(process.cpu_times()[:4])


def _times(seconds: float, cpu: float) -> Row:
    return {"seconds.total": seconds, "seconds.cpu": cpu, "env.cores_used": round(cpu / seconds, 3)}


def _end(code: int) -> str:
    """Describe how a process without an answer ended."""
    if code < 0:
        why = "; the system does this when memory runs out" if -code == getattr(signal, "SIGKILL", 0) else ""
        return f"the process was killed by signal {-code}{why}"
    return f"the process ended with exit code {code}"


def _end_with_parent() -> None:
    """End this process as soon as its parent process ends.

    A parent that is killed cannot stop its children, and they would go on working.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()


def _child(connection: Connection, report: bool, level: int) -> None:
    _end_with_parent()
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")  # as conf/config.yaml
    log.setLevel(level)
    method, kind, seed, time_limit = connection.recv()
    lock, due = Lock(), dict[str, float]()

    def send(message: Any) -> None:
        with lock:  # threads of a method report their progress
            connection.send(message)

    def progress(stage: str, done: int, total: int, note: str = "") -> None:
        now = perf_counter()
        if report and (done == total or now >= due.get(stage, 0.0)):
            due[stage] = now + PROGRESS_PERIOD
            send((stage, done, total, note))

    def receive() -> Task:
        send(READY)
        return connection.recv()

    try:
        done = _attempt(method, kind, receive, seed=seed, time_limit=time_limit, progress=progress)
        send(done._replace(facts={"peak_mib": _peak_mib()} | done.facts))
    except Misconfigured as error:
        send(error)


def _peak_mib() -> float:
    """Return the largest memory use of this process in MiB."""
    # On Linux, ru_maxrss starts at the peak of the parent process; VmHWM does not.
    high_water = process_memory("VmHWM")
    if high_water is not None:
        return high_water / 2**20
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset / 2**20
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # macOS counts bytes


def _facts(result: DeformationResult, *, ours: bool) -> Row:
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
