"""Call a method in a new process, and time the call from outside.

Only a new process has a meaningful peak of memory, and only a new process can be stopped at a time limit.
Methods of others run in new processes, so that they change neither measures nor clocks nor other runs. This
process unpickles nothing from them: it reads their messages as JSON, and checks what they tell.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from threading import Lock, Thread
from time import perf_counter
from typing import Any

import numpy as np
import psutil

from eval.metrics import Task
from eval.run.attempt import (
    CLOCKED,
    NOTHING,
    Attempt,
    BadResult,
    Misconfigured,
    attempt_task,
    facts_of,
    log,
    times_of,
    warmed_up,
)
from eval.run.environment import process_memory
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationResult

#: Least time limit in seconds for imports, compilation and warm-up, in runs with a time limit.
WARM_UP_LIMIT = 60.0

#: Seconds after the time limit in which a method that runs a program may tell the last words of the program.
LAST_WORDS = 1.0

#: Seconds between two looks whether a process without an answer still runs.
ALIVE_PERIOD = 1.0

#: Shortest time in seconds between two progress messages of one stage from a new process.
PROGRESS_PERIOD = 0.2


def attempt_fresh(
    method: Mapping[str, Any], task: Task, *, seed: int, time_limit: float | None, progress: Progress = silent
) -> Attempt:
    """Run a method as :func:`eval.run.attempt.attempt`, in a new process; also measure ``peak_mib``.

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
        done = _answer(ours, psutil.Process(process.pid), task, time_limit, progress)
        return done._replace(facts=done.facts | warmed_up(method))
    except BadResult as error:
        return Attempt(NOTHING | {"reason": str(error)})
    except (EOFError, OSError):
        process.join(ALIVE_PERIOD)
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
    BadResult
        When the answer is none.
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
        match _received(connection):
            case ["progress", str(name), int(step), int(total), str(note)]:
                progress(name, step, total, note)
            case ["ready"] if stage != "no result":  # a method cannot set the clock back
                connection.send(task)
                stage, limit = "no result", (time_limit or 0.0) + LAST_WORDS
                begin, cpu = perf_counter(), _cpu_seconds_of(child)
            case ["misconfigured", str(text)]:
                raise Misconfigured(text)
            case ["failed" | "skipped" | "timeout" as status, str(reason)]:
                return Attempt(NOTHING | {"status": status, "reason": reason})
            case ["result", dict(told)] if stage == "no result":
                data = connection.recv_bytes()
                times = times_of(perf_counter() - begin, _cpu_seconds_of(child) - cpu)
                if time_limit is None or times["seconds.total"] <= time_limit:
                    done = _checked(told, data)
                    return done._replace(facts=done.facts | times)
                break
    assert time_limit is not None, "without a limit, a message ends the loop"
    limit = time_limit if stage == "no result" else limit
    return Attempt(NOTHING | {"status": "timeout", "reason": f"{stage} within {limit:g} s"})


def _received(connection: Connection) -> Any:
    """Return a message of a process: text, numbers, and lists and mappings of them."""
    try:
        return json.loads(connection.recv_bytes())
    except ValueError as error:
        raise BadResult("the method wrote into the connection of its process") from error


def _checked(told: dict[str, Any], data: bytes) -> Attempt:
    """Return the facts and vertices of a result, checked as those of a method in this process."""

    def group(prefix: str) -> dict[str, Any]:
        return {name.removeprefix(prefix): told[name] for name in told if name.startswith(prefix)}

    seconds = {name: value for name, value in group("seconds.").items() if name not in CLOCKED}
    extra = group("extra.") | {"options": group("method.")}
    try:
        vertices = np.frombuffer(data).reshape(-1, 3)
        result = DeformationResult(vertices, told["iterations"], told["converged"], seconds, extra)
        peak = {"peak_mib": float(told["peak_mib"])}
    except (KeyError, TypeError, ValueError, FloatingPointError) as error:
        raise BadResult(f"the method's process tells no result ({error!r})") from error
    return Attempt(facts_of(result, ours=False) | peak, vertices)


def _has_ended(process: psutil.Process) -> bool:
    """Whether a child process has ended; its state stays readable until it is joined."""
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def _cpu_seconds_of(process: psutil.Process) -> float:
    """Return the CPU time of a process and of its finished child processes."""
    return sum(process.cpu_times()[:4])


def _end(code: int | None) -> str:
    """Describe how a process without an answer ended; None if it goes on."""
    if code is None:
        return "the process closed its connection"
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
    del sys.argv[1:]  # the words of the command name the case
    method, kind, seed, time_limit = connection.recv()
    lock, due = Lock(), dict[str, float]()

    def tell(*message: Any, data: np.ndarray | None = None) -> None:
        with lock:  # threads of a method report their progress
            connection.send_bytes(json.dumps(message).encode())
            if data is not None:
                connection.send_bytes(data.astype(np.float64).tobytes())

    def progress(stage: str, done: int, total: int, note: str = "") -> None:
        now = perf_counter()
        if report and (done == total or now >= due.get(stage, 0.0)):
            due[stage] = now + PROGRESS_PERIOD
            tell("progress", stage, done, total, note)

    def receive() -> Task:
        tell("ready")
        return connection.recv()

    try:
        facts, vertices = attempt_task(
            method, kind, receive, seed=seed, time_limit=time_limit, progress=progress
        )
    except Misconfigured as error:
        tell("misconfigured", str(error))
    else:
        if vertices is None:
            tell(facts["status"], facts["reason"])
        else:
            tell("result", {"peak_mib": _peak_mib()} | facts, data=vertices)
    with suppress(EOFError):  # the process that waits for the result reads the clocks, and ends this one
        connection.recv_bytes()


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
