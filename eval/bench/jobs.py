"""Time calls of methods, subdivided meshes, drags of a bound mesh, and the whole command."""

from __future__ import annotations

import multiprocessing
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from eval.bench.calls import Calls
from eval.bench.cases import TimedCase, TimedMethod, deformation, moved
from eval.bench.drags import drag_of
from eval.bench.turns import Job, take_turns
from eval.rows.store import Row
from eval.run.environment import method_facts, process_memory, reset_peak_memory, task_facts
from eval.run.warmup import tiny_task
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles

#: ``python -m sshade``, followed by the status of the process, which holds the peak of its memory.
PROGRAM = """
import os, runpy
try:
    runpy.run_module("sshade", run_name="__main__", alter_sys=True)
finally:
    if os.path.exists("/proc/self/status"):
        print(open("/proc/self/status").read())
"""


def time_calls(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time calls of methods on tasks, in turns. Rows have measures of the last result, and ``quality``.

    ``quality`` names the files with rows of equal runs, whose measures agree; see
    :func:`eval.bench.quality.require_quality`.
    """
    timed = [Calls(method, task, case) for case in cases for task in [case.load()] for method in methods]
    rows = take_turns([calls.job for calls in timed], rounds=rounds)
    for calls in timed:
        quality = calls.quality()
        for row in rows:
            if calls.job.facts.items() <= row.items():
                row |= quality
    return rows


def time_drags(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time drags of methods that can be bound, in turns."""
    tasks = [case.load() for case in cases]
    jobs = [
        Job(method_facts(method.label, method.config) | task_facts(task), drag_of(method, task))
        for task in tasks
        for method in methods
    ]
    return take_turns(jobs, rounds=rounds)


def time_scaling(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time methods on subdivided meshes, each in a new process, and measure their memory.

    Rows have ``peak_mib``: the peak of memory during a call, minus the memory before the first call. None if
    the system does not report it.
    """
    return [row for case in cases for row in in_new_process(_time_case, methods, case, rounds)]


def in_new_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a new process; return its result."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def _time_case(methods: Sequence[TimedMethod], case: TimedCase, rounds: int) -> list[Row]:
    task = case.load()
    say(f"{task.name}: {task.mesh.n:,} vertices")
    jobs = [Calls(method, task, case).job for method in methods]
    copied = moved(task, 0)  # each call has such a copy
    before = process_memory("VmRSS")
    del copied
    return take_turns([job._replace(call=partial(_with_peak, job, before)) for job in jobs], rounds=rounds)


def _with_peak(job: Job, before: int | None) -> Row:
    """Call a job; add the peak of memory above `before`, in bytes."""
    if before is None:
        return job.call() | {"peak_mib": None}
    reset_peak_memory()
    row, peak = job.call(), process_memory("VmHWM")
    assert peak is not None, "the system has reported the memory before"
    return row | {"peak_mib": (peak - before) / 2**20}


def time_commands(methods: Sequence[str], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time ``sshade deform --method METHOD`` from start to end, with imports and binary PLY files.

    Without cases, a tiny mesh is deformed: the time is then mostly of imports and cached kernels. Rows have
    ``seconds.method``, the time of the method as the command prints it, and ``peak_mib`` of the process.
    """
    rows = []
    for load in [case.load for case in cases] or [tiny_task]:
        task = deformation(load())
        say(f"{task.name}: {task.mesh.n:,} vertices")
        with TemporaryDirectory() as folder:
            mesh, handles, out = (str(Path(folder, name)) for name in ("m.ply", "h.json", "o.ply"))
            write_mesh(mesh, task.mesh.V, task.mesh.F)
            write_handles(handles, task.handles)
            facts, jobs = task_facts(task), []
            del task  # frees its memory before the repeats
            for method in methods:
                words = ["deform", "--method", method]
                own = method_facts(f"sshade {' '.join(words)}", {"command": words})
                jobs.append(Job(facts | own, partial(_call_command, [*words, mesh, handles, "-o", out])))
            rows += take_turns(jobs, rounds=rounds)
    return rows


def _call_command(arguments: list[str]) -> Row:
    begin = perf_counter()
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True)
    seconds = perf_counter() - begin
    if done.returncode:
        raise InputError(f"sshade {' '.join(arguments)}: {done.stderr.strip().removeprefix('error: ')}")
    printed = re.findall(r", ([\d.]+) s$", done.stderr, re.MULTILINE)
    peak = re.search(r"^VmHWM:\s*(\d+) kB$", done.stdout, re.MULTILINE)
    mib = int(peak[1]) / 1024 if peak else None
    return {"seconds.total": seconds, "seconds.method": float(printed[0]), "peak_mib": mib}
