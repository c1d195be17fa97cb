"""Run a program, measure it, and end it with all of its child processes."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from time import perf_counter
from typing import NamedTuple

import psutil

from sshade.core.errors import InputError

#: Seconds between two readings of the memory. A reading takes at most a twentieth of the time between two.
PERIOD = 0.02
#: Largest number of letters of a program's last line in a message.
LETTERS = 300


class ProgramFailed(Exception):
    """A program ended without a result; the message includes the last line of its standard error."""


class Finished(NamedTuple):
    """A program that ended well.

    Attributes
    ----------
    seconds : float
        Wall-clock time from its start to its end.
    peak_mib : float
        Largest memory of the program and its child processes together.
    """

    seconds: float
    peak_mib: float


def run_program(
    command: Sequence[str], *, variables: Mapping[str, str], errors: Path, limit: float | None = None
) -> Finished:
    """Run a program without a shell, in a process group of its own; kill the group in the end.

    The group is also killed when this process ends first, even if this process is killed.

    Parameters
    ----------
    command : sequence of str
    variables : mapping
        Further environment variables.
    errors : path
        File to which the program's standard error goes. Its standard output is thrown away.
    limit : float, optional
        Longest time in seconds.

    Raises
    ------
    InputError
        When the program cannot be started.
    TimeoutError
        At the limit.
    ProgramFailed
        On an exit code other than 0.
    """
    guard = _guard()
    begin = perf_counter()
    try:
        with errors.open("wb") as stream:
            try:
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=stream,
                    env=_environment(variables),
                    process_group=None if guard is None else guard.pid,
                )
            except (OSError, ValueError) as error:
                raise InputError(f"the program {command[0]} does not start ({error})") from error
        watch = _Watch(process.pid, guard, None if limit is None else begin + limit)
        try:
            watch.start()
            code = process.wait()  # a wait with a time limit would look every 50 ms only
            seconds = perf_counter() - begin
        finally:
            watch.end()
            process.wait()
    finally:
        if guard is not None:
            guard.kill()
            guard.communicate()
    if watch.late:
        raise TimeoutError(f"no result within {limit:g} s{last_line(errors)}")
    if code:
        raise ProgramFailed(f"the program {_ending(code)}{last_line(errors)}")
    return Finished(seconds, watch.peak / 2**20)


def _environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a program, in which Python finds the files beside the program."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"} | dict(variables)


def last_line(errors: Path) -> str:
    """Return the last line of a file as the end of a message; "" for a file without lines."""
    with errors.open("rb") as stream:
        stream.seek(max(0, errors.stat().st_size - 8 * LETTERS))
        lines = stream.read().decode(errors="replace").split("\n")
    said = [" ".join("".join(c if c.isprintable() else " " for c in line).split()) for line in lines]
    last = next((line for line in reversed(said) if line), "")
    return f"; its last line was: {last[-LETTERS:]}" if last else "; it said nothing"


def _guard() -> subprocess.Popen[bytes] | None:
    """Start a process with a process group, and have it kill the group as soon as this process ends.

    A program that is started in the group cannot outlive this process, whenever and however it ends.
    """
    if os.name != "posix":
        return None
    # The system closes the pipe when this process ends, and the guard then reads the end of its input.
    words = ["/bin/sh", "-c", 'read -r line; kill -s KILL -- "-$$"']
    return subprocess.Popen(
        words,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        process_group=0,
    )


def _ending(code: int) -> str:
    if code > 0:
        return f"ended with exit code {code}"
    why = ", as the system does when memory runs out" if code == -9 else ""
    return f"was killed by signal {-code}{why}"


class _Watch(Thread):
    """Reads the memory of a process and its descendants, and kills all of them at a deadline."""

    def __init__(self, pid: int, guard: subprocess.Popen[bytes] | None, deadline: float | None) -> None:
        super().__init__(daemon=True)
        self.peak, self.late = 0, False
        self._root, self._guard, self._deadline = psutil.Process(pid), guard, deadline
        self._seen: set[psutil.Process] = set()
        self._over = Event()

    def run(self) -> None:
        pause = 0.0
        while not self._over.wait(pause):
            begin = perf_counter()
            self._read()
            now = perf_counter()
            if self._deadline is not None and now >= self._deadline:
                self.late = True
                self._kill()
                return
            pause = max(PERIOD, 20 * (now - begin))
            if self._deadline is not None:
                pause = min(pause, self._deadline - now)

    def end(self) -> None:
        """Kill all processes that are left, and end the thread."""
        self._over.set()
        if self.is_alive():
            self.join()
        self._read()
        self._kill()

    def _read(self) -> None:
        with suppress(psutil.Error):
            processes = [self._root, *self._root.children(recursive=True)]
            self._seen.update(processes)
            used = [_memory(process) for process in processes]
            self.peak = max(self.peak, sum(now for now, _ in used), *(most for _, most in used))

    def _kill(self) -> None:
        if self._guard is not None:
            with suppress(ProcessLookupError, PermissionError):  # macOS refuses a group that has just ended
                os.killpg(self._guard.pid, signal.SIGKILL)
        for process in self._seen:
            with suppress(psutil.Error):  # psutil kills no other process that got the same number
                process.kill()


def _memory(process: psutil.Process) -> tuple[int, int]:
    """Return the memory of a process in bytes, now and at its peak; the peak is 0 where it is unknown."""
    most = 0
    with suppress(psutil.Error):
        now = process.memory_info().rss
        with suppress(OSError, IndexError):
            text = Path(f"/proc/{process.pid}/status").read_text()
            most = 1024 * int(text.partition("VmHWM:")[2].split()[0])
        return now, most
    return 0, 0
