"""What a call of ``sshade deform`` takes from start to end, files and imports included."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from eval.rows.store import Row
from eval.run.provenance import config_hash, library_versions
from eval.run.targets import instantiate
from eval.run.warmup import tiny_task
from eval.timing.cases import task_facts
from eval.timing.scaling import nearest, subdivided
from eval.timing.turns import Job, take_turns
from sshade.cli.console import say
from sshade.errors import InputError
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh
from sshade.task import DeformationTask

#: What these rows are of.
KIND = "whole"
#: ``python -m sshade``, which tells the peak of its memory in the end, where the system does.
PROGRAM = """
import os, runpy
try:
    runpy.run_module("sshade", run_name="__main__", alter_sys=True)
finally:
    if os.path.exists("/proc/self/status"):
        print(open("/proc/self/status").read())
"""


def time_commands(
    methods: Sequence[str], sources: Sequence[dict[str, Any]], *, rounds: int, sizes: Sequence[int] = ()
) -> list[Row]:
    """Time `sshade deform` on binary PLY files.

    Parameters
    ----------
    methods : sequence of str
        Values of its option ``--method``.
    sources : sequence of dict
        Configurations that load tasks; with none, a mesh so small that imports and cached kernels are all
        there is.
    rounds : int
    sizes : sequence of int
        Numbers of vertices; for each the subdivision of a case that comes nearest is taken.

    Returns
    -------
    list of dict
        Rows with ``seconds.total``, ``seconds.method``, what the command says of the method alone, and
        ``peak_mib``, the memory of its process in all; None where the system does not tell.

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`; and where the command refuses a method.
    """
    rows = []
    for task in _tasks(sources, sizes):
        say(f"{task.name}: {task.mesh.n:,} vertices")
        with TemporaryDirectory() as folder:
            mesh, handles, out = (str(Path(folder, name)) for name in ("m.ply", "h.json", "o.ply"))
            write_mesh(mesh, task.mesh.V, task.mesh.F)
            write_handles(handles, task.handles)
            files, facts = (mesh, handles, "-o", out), task_facts(task)
            del task  # which may be large
            rows += take_turns([_job(method, files, facts) for method in methods], rounds=rounds)
    return rows


def _tasks(sources: Sequence[dict[str, Any]], sizes: Sequence[int]) -> Iterator[DeformationTask]:
    if not sources:
        yield tiny_task()
    elif not sizes:
        yield from map(instantiate, sources)
    else:
        bases = [instantiate(source) for source in sources]
        for _, base, level in nearest([task.mesh.n for task in bases], sizes):
            yield subdivided(bases[base], level)


def _job(method: str, files: Sequence[str], facts: Row) -> Job:
    options = ["deform", "--method", method]
    own = {
        "kind": KIND,
        "method.name": f"sshade {' '.join(options)}",
        "method.hash": config_hash({"command": options}),
    }
    own |= {f"env.version.{name}": version for name, version in library_versions([]).items()}
    return Job(own | facts, partial(_call, ["sshade", *options, *files]))


def _call(command: list[str]) -> Row:
    begin = perf_counter()
    done = subprocess.run([sys.executable, "-c", PROGRAM, *command[1:]], capture_output=True, text=True)
    seconds = perf_counter() - begin
    if done.returncode:
        raise InputError(f"{' '.join(command)}: {done.stderr.strip().removeprefix('error: ')}")
    told = re.search(r", ([\d.]+) s$", done.stderr, re.MULTILINE)
    if told is None:
        raise RuntimeError(f"{' '.join(command)} told no time: {done.stderr!r}")
    peak = re.search(r"^VmHWM:\s*(\d+) kB$", done.stdout, re.MULTILINE)
    return {
        "seconds.total": seconds,
        "seconds.method": float(told[1]),
        "peak_mib": int(peak[1]) / 1024 if peak else None,
    }
