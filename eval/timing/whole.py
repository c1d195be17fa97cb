"""Time the command ``sshade deform`` from start to end, with imports and files."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from eval.rows.store import Row
from eval.run.provenance import config_hash, library_facts, task_facts
from eval.run.warmup import tiny_task
from eval.timing.timed_cases import TimedCase
from eval.timing.turns import Job, take_turns
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


def time_commands(methods: Sequence[str], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time ``sshade deform`` on binary PLY files.

    Parameters
    ----------
    methods : sequence of str
        Values of the option ``--method``.
    cases : sequence of TimedCase
        If empty, a tiny mesh is deformed: the time is then mostly of imports and cached kernels.
    rounds : int

    Returns
    -------
    list of dict
        Rows with ``seconds.total``; ``seconds.method``, the time of the method as the command prints it;
        and ``peak_mib``, the peak memory of the process, None if the system does not report it.

    Raises
    ------
    InputError
        As :func:`eval.timing.turns.take_turns`; and if the command fails.
    """
    rows = []
    for load in [case.load for case in cases] or [tiny_task]:
        task = load()
        say(f"{task.name}: {task.mesh.n:,} vertices")
        with TemporaryDirectory() as folder:
            mesh, handles, out = (str(Path(folder, name)) for name in ("m.ply", "h.json", "o.ply"))
            write_mesh(mesh, task.mesh.V, task.mesh.F)
            write_handles(handles, task.handles)
            files, facts = (mesh, handles, "-o", out), task_facts(task)
            del task  # frees its memory before the repeats
            rows += take_turns([_job(method, files, facts) for method in methods], rounds=rounds)
    return rows


def _job(method: str, files: Sequence[str], facts: Row) -> Job:
    options = ["deform", "--method", method]
    facts = facts | {"method.name": f"sshade {' '.join(options)}"} | library_facts([])
    facts["method.hash"] = config_hash({"command": options})
    return Job(facts, partial(_call, [*options, *files]))


def _call(arguments: list[str]) -> Row:
    begin = perf_counter()
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True)
    seconds = perf_counter() - begin
    command = " ".join(["sshade", *arguments])
    if done.returncode:
        raise InputError(f"{command}: {done.stderr.strip().removeprefix('error: ')}")
    printed = re.search(r", ([\d.]+) s$", done.stderr, re.MULTILINE)
    if printed is None:
        raise RuntimeError(f"{command} printed no time: {done.stderr!r}")
    peak = re.search(r"^VmHWM:\s*(\d+) kB$", done.stdout, re.MULTILINE)
    mib = int(peak[1]) / 1024 if peak else None
    return {"seconds.total": seconds, "seconds.method": float(printed[1]), "peak_mib": mib}
