"""Call a method on a task and time the call, in this process or in a new one.

Only a new process has a meaningful peak of memory, and only a new process can be stopped at a time limit.
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
from eval.rows.store import Row
from eval.run.environment import process_memory, task_checksum
from eval.run.targets import flat, instantiate
from eval.run.warmup import warm_up
from sshade.core.console import Ended, arrived_in, missing_library
from sshade.core.progress import Progress, silent
from sshade.problem.facts import Facts
from sshade.problem.task import DeformationResult, result_of

log = logging.getLogger(__name__)

#: Facts of a method without a result.
NOTHING: Row = {"status": "failed", "reason": "", "iterations": None, "converged": None}

#: Reason of a row whose method wrote into the arrays of its task, which later methods would be given.
WROTE = "the method changed the task that it was given; it must copy arrays before it writes into them"

#: Stages that the evaluator measures itself, and columns that say which method ran. A method sets neither.
CLOCKED = ("total", "cpu")
IDENTITY = tuple(f"method.{name}" for name in ("name", "target", "hash", "version", "note", "seed"))

#: Messages from a new process when its clock starts, and when it stops.
CLOCK, STOPPED = "clock", "stopped"

#: Variable with the time limit of a run in seconds, for methods that run programs; missing without a limit.
TIME_LIMIT = "EVAL_TIME_LIMIT"

#: Least time limit in seconds for imports, compilation and warm-up, and for what follows the method, in runs
#: with a time limit.
WARM_UP_LIMIT = 60.0

#: Seconds after the time limit in which a method that runs a program may tell the last words of the program.
LAST_WORDS = 1.0

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


def attempt(
    method: Mapping[str, Any],
    task: Task,
    *,
    seed: int,
    time_limit: float | None = None,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda message: None,
) -> Attempt:
    """Run a method. An exception or exit of the method becomes the status and reason of the row.

    A method that writes into its task fails with the reason :data:`WROTE`, and the task must be loaded again.

    Parameters
    ----------
    method : mapping
        Configuration of the method: ``_target_``, parameters, ``warm_up``.
    task : DeformationTask or TransferTask
    seed : int
    time_limit : float, optional
        Told to the method in the environment variable :data:`TIME_LIMIT`. The method may end itself with a
        TimeoutError.
    progress : Progress
    tell : callable
        Gets :data:`CLOCK` after the warm-up, and :data:`STOPPED` when the method has returned.
    """
    row = NOTHING | {"env.warmed_up": method.get("warm_up", {}) is not None}
    before = task_checksum(task)
    try:
        call = instantiate({**method, "_partial_": True})
        if row["env.warmed_up"]:
            progress("warm-up", 0, 1)
            warm_up(method, kind=type(task))
            progress("warm-up", 1, 1)
        tell(CLOCK)
        with _told(time_limit):
            begin, cpu = perf_counter(), _cpu_seconds()
            result = result_of(task, call(task, seed=seed, progress=progress))
            vertices = np.array(result.vertices)  # a copy, which a thread of the method does not know
            seconds, cpu = perf_counter() - begin, _cpu_seconds() - cpu
        tell(STOPPED)
        done = Attempt(row | _facts(result, seconds, cpu), vertices)
    except ImportError as error:
        done = Attempt(row | {"status": "skipped", "reason": reason_of(error)})
    except Ended:
        raise
    except (Exception, SystemExit) as error:  # a method may raise anything; the sweep continues
        if isinstance(signalled := arrived_in(error), KeyboardInterrupt | Ended):
            raise signalled from None
        log.debug("%s", method["_target_"], exc_info=True)
        late = isinstance(error, TimeoutError) and time_limit is not None
        failure = {"status": "timeout", "reason": str(error)} if late else {"reason": reason_of(error)}
        done = Attempt(row | failure)
    return done if task_checksum(task) == before else Attempt(row | {"reason": WROTE})


def attempt_fresh(
    method: Mapping[str, Any], task: Task, *, seed: int, time_limit: float | None, progress: Progress = silent
) -> Attempt:
    """Run :func:`attempt` in a new process, which also measures ``peak_mib``.

    The warm-up has the same limit, at least :data:`WARM_UP_LIMIT`; the `time_limit` starts after it. The peak
    of memory includes libraries, the warm-up and the method.
    """
    # A worker of joblib has a start method that is unknown in a child process.
    method_of_start = multiprocessing.get_start_method(allow_none=True)
    if method_of_start not in (None, *multiprocessing.get_all_start_methods()):
        multiprocessing.set_start_method("spawn", force=True)
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_child, args=(theirs, progress is not silent), daemon=False)
    try:
        with _no_interrupts() if os.name == "posix" else nullcontext():
            process.start()
        theirs.close()
        # Arguments of the process could block `start` for ever if the process ended before reading them.
        ours.send((method, task, seed, time_limit))
        return _answer(ours, time_limit, progress)
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


def _answer(connection: Connection, time_limit: float | None, progress: Progress) -> Attempt:
    """Pass on the progress of the child; return its result, or the timeout."""
    around = max(WARM_UP_LIMIT, time_limit or 0.0)
    stage, limit = "the warm-up did not end", around
    begin = perf_counter()
    while connection.poll(None if time_limit is None else max(0.0, begin + limit - perf_counter())):
        message = connection.recv()
        if isinstance(message, Attempt):
            seconds = message.facts.get("seconds.total", 0.0)
            if time_limit is None or seconds <= time_limit:
                return message
            stage = "no result"
            break
        if message == CLOCK:
            stage, limit, begin = "no result", (time_limit or 0.0) + LAST_WORDS, perf_counter()
        elif message == STOPPED:
            stage, limit, begin = "the result was not sent", around, perf_counter()
        else:
            progress(*message)
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


def _child(connection: Connection, report: bool) -> None:
    _end_with_parent()
    method, task, seed, time_limit = connection.recv()
    lock, due = Lock(), dict[str, float]()

    def send(message: Any) -> None:
        with lock:  # threads of a method report their progress
            connection.send(message)

    def progress(stage: str, done: int, total: int, note: str = "") -> None:
        now = perf_counter()
        if report and (done == total or now >= due.get(stage, 0.0)):
            due[stage] = now + PROGRESS_PERIOD
            send((stage, done, total, note))

    done = attempt(method, task, seed=seed, time_limit=time_limit, progress=progress, tell=send)
    send(done._replace(facts={"peak_mib": _peak_mib()} | done.facts))


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


def _facts(result: DeformationResult, seconds: float, cpu: float) -> Row:
    row: Row = {
        "status": "not_converged" if result.converged is False else "ok",
        "iterations": float(result.iterations),
        "converged": None if result.converged is None else bool(result.converged),
        "seconds.total": seconds,
        "seconds.cpu": cpu,
        "env.cores_used": round(cpu / seconds, 3),
    }
    stages = {stage: float(value) for stage, value in result.seconds.items() if stage not in CLOCKED}
    row |= {f"seconds.{stage}": value for stage, value in stages.items()}
    found = {**(vars(result.facts) if result.facts != Facts() else {}), **result.extra}
    row |= {f"extra.{name}": _plain(value) for name, value in found.items() if is_scalar(value)}
    if "peak_mib" in result.extra:  # a method that runs a program measures the memory of the program
        row["peak_mib"] = row.pop("extra.peak_mib")
    options = flat(found.get("options", {}), "method")
    row |= {name: value for name, value in options.items() if name not in IDENTITY}
    return row


def is_scalar(value: Any) -> bool:
    """Whether a value fits into a cell of a row."""
    return value is None or isinstance(value, (bool, int, float, str, np.generic))


def _plain(value: Any) -> Any:
    """Return a Python scalar that JSON can hold: no numpy types, None for NaN and infinities."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def reason_of(error: BaseException) -> str:
    """Return the type and the message of an error in one line."""
    text = " ".join((missing_library(error, EXTRAS) or str(error)).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
