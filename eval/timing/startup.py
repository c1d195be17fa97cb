"""What a call of the command line costs beside its work."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from eval.rows.store import Row
from eval.run.provenance import config_hash, library_versions
from eval.run.warmup import tiny_task
from eval.timing.cases import task_facts
from eval.timing.turns import Job, take_turns
from sshade.errors import InputError
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh

#: What these rows are of.
KIND = "startup"


def time_start_up(methods: Sequence[str], *, rounds: int) -> list[Row]:
    """Time `sshade deform` on a mesh so small that imports and cached kernels are all there is.

    Parameters
    ----------
    methods : sequence of str
        Values of its option ``--method``.
    rounds : int

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`; and where the command refuses a method.
    """
    task = tiny_task()
    with TemporaryDirectory() as folder:
        mesh, handles, out = (str(Path(folder, name)) for name in ("m.ply", "h.json", "o.ply"))
        write_mesh(mesh, task.mesh.V, task.mesh.F)
        write_handles(handles, task.handles)
        jobs = []
        for method in methods:
            command = ["sshade", "deform", mesh, handles, "-o", out, "--method", method]
            facts = {
                "kind": KIND,
                "method.name": f"sshade deform --method {method}",
                "method.hash": config_hash({"command": ["deform", "--method", method]}),
            }
            facts |= {f"env.version.{name}": version for name, version in library_versions([]).items()}
            jobs.append(Job(facts | task_facts(task), partial(_call, command)))
        return take_turns(jobs, rounds=rounds)


def _call(command: list[str]) -> Row:
    begin = perf_counter()
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True)
    seconds = perf_counter() - begin
    if done.returncode:
        raise InputError(f"{' '.join(command)}: {done.stderr.strip().removeprefix('error: ')}")
    return {"seconds.total": seconds}
