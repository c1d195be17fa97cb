"""Time this version of the project and an older commit in turns, each in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from eval.rows.store import Row
from eval.run.provenance import config_hash, library_facts, task_facts
from eval.timing.cases import TimedCase
from eval.timing.drag import STEPS, TOLERANCE
from eval.timing.turns import Job, take_turns
from sshade.cli.console import say
from sshade.errors import InputError
from sshade.io.meshes import write_mesh
from sshade.task import DeformationTask

#: Methods of :func:`sshade.deform` and :class:`sshade.Deformer` whose drags are timed.
METHODS = ("fast", "fine", "paper", "drag fast", "drag paper")
#: Name of the present version in rows.
NOW = "now"
#: Folder of the checkout, and of older commits.
HERE, OLDER = Path(__file__).parents[2], Path("out/versions")


def time_versions(
    methods: Sequence[str], cases: Sequence[TimedCase], *, rounds: int, against: str
) -> list[Row]:
    """Time methods of this version and of a commit.

    Parameters
    ----------
    methods : sequence of str
        Of :data:`METHODS`; the time of a drag is the median of its steps.
    cases : sequence of TimedCase
    rounds : int
    against : str
        Commit of this project, as git names it. Its files are written to :data:`OLDER`.

    Raises
    ------
    InputError
        As :func:`eval.timing.turns.take_turns`; on another method, case or commit; and if the commit fails.
    """
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise InputError(f"versions times {', '.join(METHODS)}, not {unknown[0]!r}")
    commit, folder = _checkout(against)
    with ExitStack() as stack, TemporaryDirectory() as files:
        workers = {commit[:7]: Worker(folder), NOW: Worker(HERE)}
        for worker in workers.values():
            stack.callback(worker.end)
        jobs = []
        for number, case in enumerate(cases):
            task = case.load()
            if not isinstance(task, DeformationTask) or not task.handles.hard.all():
                raise InputError(f"{task.name}: versions times deformations with hard handles")
            path, name, handles = str(Path(files, f"{number}.ply")), f"{number} {task.name}", task.handles
            write_mesh(path, task.mesh.V, task.mesh.F)
            lists = {key: getattr(handles, key).tolist() for key in ("index", "target", "group")}
            for worker in workers.values():
                worker.ask(load=path, name=name, **lists)
            facts = task_facts(task)
            jobs += [
                _job(method, version, worker, name, facts)
                for method in methods
                for version, worker in workers.items()
            ]
        return take_turns(jobs, rounds=rounds)


def _job(method: str, version: str, worker: Worker, case: str, facts: Row) -> Job:
    *kind, name = method.split()
    request: dict[str, Any] = {"name": case, "method": name}
    if kind:
        request |= {"drag": STEPS, "tolerance": TOLERANCE}
    facts = facts | library_facts([])
    facts |= {"method.base": method, "method.version": version, "method.name": f"{method}, {version}"}
    facts["method.hash"] = config_hash({"method": method})
    return Job(facts, partial(worker.ask, **request))


class Worker:
    """A process that deforms with the version of the project in a folder; see :mod:`eval.timing.worker`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        program = [sys.executable, "-P", str(Path(__file__).with_name("worker.py"))]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen(program, env=os.environ | {"PYTHONPATH": str(folder)}, **pipes)

    def ask(self, **request: Any) -> Row:
        """Send a request; return its answer."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps(request), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            what = ", ".join(str(value) for value in request.values() if not isinstance(value, list))
            raise InputError(f"the version in {self._folder} failed at {what}; its message is above")
        row: Row = json.loads(answer)
        return row

    def end(self) -> None:
        """End the process."""
        self._process.communicate()


def _checkout(against: str) -> tuple[str, Path]:
    """Write the files of a commit to a folder, unless it has them; return its full name and the folder."""
    git = ["git", "-C", str(HERE)]
    found = subprocess.run(
        [*git, "rev-parse", "--verify", "--quiet", f"{against}^{{commit}}"], capture_output=True, text=True
    )
    if found.returncode:
        raise InputError(f"--against {against!r} is no commit of this checkout")
    commit = found.stdout.strip()
    folder = (OLDER / commit).resolve()
    if not folder.is_dir():
        say(f"writing {commit[:7]} to {folder}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent) as partly:
            archive = subprocess.run([*git, "archive", commit], check=True, capture_output=True).stdout
            subprocess.run(["tar", "-x", "-C", partly], check=True, input=archive)
            (Path(partly) / ".complete").touch()
            os.rename(partly, folder)
            Path(partly).mkdir()  # for the end of the block
    return commit, folder
