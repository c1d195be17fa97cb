"""What is timed: calls of methods, subdivided meshes, drags of a bound mesh, and the whole command."""

from __future__ import annotations

import multiprocessing
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

import igl
import numpy as np

from eval.bench.quality import COMPARED, require_quality
from eval.bench.turns import Job, take_turns
from eval.metrics import MEASURES, Task, measure
from eval.rows.store import Row
from eval.run.attempt import attempt, attempt_fresh
from eval.run.config import task_of, with_truth
from eval.run.environment import digest, method_facts, process_memory, reset_peak_memory, task_facts
from eval.run.run import given
from eval.run.targets import is_ours, locate
from eval.run.warmup import tiny_task
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from sshade.mesh.mesh import Mesh
from sshade.method.bound import Deformer
from sshade.method.call import deform
from sshade.problem.options import accepted
from sshade.problem.task import DeformationTask, TransferTask

#: Number of iterations from which the time of all iterations is estimated.
BLOCK = 10
#: Distance by which the targets of a call differ from the task, as a fraction of the diagonal.
HAIR = 1e-6
#: Number of steps of a drag from rest to the targets, and residual at which each step stops.
STEPS, TOLERANCE = 60, 1e-4
#: ``python -m sshade``, followed by the status of the process, which holds the peak of its memory.
PROGRAM = """
import os, runpy
try:
    runpy.run_module("sshade", run_name="__main__", alter_sys=True)
finally:
    if os.path.exists("/proc/self/status"):
        print(open("/proc/self/status").read())
"""


class TimedMethod(NamedTuple):
    """A method by its name in tables, its configuration, and whether its time is extrapolated."""

    label: str
    config: dict[str, Any]
    extrapolated: bool = False


class TimedCase(NamedTuple):
    """The configuration that loads a task, and a number of midpoint subdivisions; None keeps the task."""

    source: dict[str, Any]
    level: int | None = None

    def load(self) -> Task:
        """Load the task and subdivide it. Subdivision keeps the vertices and the handles on them."""
        task = task_of(self.source, truth=False)
        if self.level is None:
            return task
        task = deformation(task)
        V, F = igl.upsample(np.array(task.mesh.V), np.array(task.mesh.F), self.level)
        return DeformationTask(f"{task.name}, level {self.level}", Mesh(V, F), task.handles)


def deformation(task: Task) -> DeformationTask:
    """Return a task of a deformation; raise InputError for a pose transfer."""
    if not isinstance(task, DeformationTask):
        raise InputError(f"{task.name} is a pose transfer; only `speed` times transfers, without --sizes")
    return task


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
        Job(method_facts(method.label, method.config) | task_facts(task), _drag_of(method, task))
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


def moved(task: Task, number: int) -> Task:
    """Return what a method is given in a call: new meshes, a hash as name, and targets moved by a hair.

    Each group of moved handles, or the pose of a transfer, is moved by :data:`HAIR` diagonals. Each number
    has another direction.
    """
    task = given(task)
    rng = np.random.default_rng(number)
    if isinstance(task, TransferTask):
        return replace(task, posed=task.posed + _hair(rng, 1) * task.mesh.diagonal)
    handles = task.handles
    _, group = np.unique(handles.group, return_inverse=True)
    shift = _hair(rng, group.max() + 1)[group] * task.mesh.diagonal
    moves = handles.dynamic if handles.dynamic.any() else ~handles.dynamic
    target = np.where(moves[:, None], handles.target + shift, handles.target)
    return replace(task, handles=replace(handles, target=target))


def _hair(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return vectors (count, 3) of the length :data:`HAIR`."""
    directions = rng.normal(size=(count, 3))
    return HAIR * directions / np.linalg.norm(directions, axis=1, keepdims=True)


class Calls:
    """Calls of a method on a task; an extrapolated method runs :data:`BLOCK` of its iterations.

    No call can use what another one has left: its meshes are new, and its targets are its own. Methods of
    others run in new processes.
    """

    def __init__(self, method: TimedMethod, task: Task, case: TimedCase) -> None:
        self.label, self.config, self.limit = method.label, method.config, 0
        self.task, self.case = task, case
        self.job = Job(method_facts(self.label, self.config) | task_facts(task), self._call)
        self.number = 0
        self.shape = ""
        self.last: tuple[Task, np.ndarray, Row] | None = None
        if method.extrapolated:
            self.limit = self.config.get("max_iterations") or 0
            if "tolerance" not in self.config or self.limit <= BLOCK:
                raise InputError(
                    f"--extrapolate needs a tolerance and more than {BLOCK} iterations of {self.label}"
                )
            self.config = self.config | {"max_iterations": BLOCK, "tolerance": 0.0}

    def _call(self) -> Row:
        self.number += 1
        task = moved(self.task, self.number)
        if is_ours(self.config):
            done = attempt(self.config, task, seed=0)
        else:
            done = attempt_fresh(self.config, task, seed=0, time_limit=None)
        facts, before = done.facts, self.shape
        self.shape = "" if done.vertices is None else digest(done.vertices.tobytes())
        if self.shape in ("", before):
            why = facts["reason"] or "it gives the same shape for other targets"
            raise InputError(f"{self.label} cannot be timed on {self.task.name}: {why}")
        if self.case.level is None and done.vertices is not None:
            self.last = task, done.vertices, facts
        row = {name: value for name, value in facts.items() if name.startswith("seconds.")}
        row |= {name: facts[name] for name in ("iterations", "converged", "env.cores_used")}
        del row["seconds.cpu"]
        return row | {"hair": HAIR} | (self._extrapolated(row) if self.limit else {})

    def _extrapolated(self, row: Row) -> Row:
        """Return the columns of all iterations from the columns of :data:`BLOCK` iterations."""
        if "seconds.solve" not in row:
            raise InputError(
                f"--extrapolate needs the time of the iterations alone, which {self.label} lacks"
            )
        solve = row["seconds.solve"] * self.limit / row["iterations"]
        total = row["seconds.total"] - row["seconds.solve"] + solve
        whole = {"seconds.total": total, "seconds.solve": solve}
        return whole | {"extrapolated_to": self.limit, "converged": None}

    def quality(self) -> Row:
        """Return measures of the last result, and ``quality``; nothing for 10 iterations and finer meshes."""
        if self.limit or self.last is None:
            return {}
        task, vertices, facts = self.last
        found = measure(with_truth(task, self.case.source), vertices)
        row = {name: found.get(name.removeprefix("metric.")) for name in COMPARED}
        options = {name: value for name, value in facts.items() if name.startswith("method.")}
        run = {"measures": MEASURES, "seed": 0}
        return row | {"quality": require_quality(self.job.facts | options | run | row)}


def _drag_of(method: TimedMethod, task: Task) -> Callable[[], Row]:
    """Return the drag of a method that :class:`sshade.Deformer` binds; each drag has a new mesh."""
    options, numbers = deformer_options(method), count(1)
    return lambda: drag(deformation(moved(task, next(numbers))), options)


def deformer_options(method: TimedMethod) -> dict[str, Any]:
    """Return the options of :class:`sshade.Deformer` from the configuration of a method that it binds."""
    label, config, name = method.label, method.config, method.config.get("method")
    if locate(config["_target_"]) is not deform or name not in ("fast", "paper"):
        raise InputError(f"{label} cannot be bound: sshade.Deformer binds the methods paper and fast")
    if config["coarse"] is not None:
        raise InputError(f"{label} cannot be bound: sshade.Deformer has its own solver of proxies")
    names = set(accepted(name)) - {"coarse"}
    return {"method": name, **{key: value for key, value in config.items() if key in names}}


def bound(task: DeformationTask, options: dict[str, Any]) -> Deformer:
    """Bind the mesh and the handles of a task."""
    handles = task.handles
    return Deformer(task.mesh, handles.index, group=handles.group, weight=handles.weight, **options)


def drag(task: DeformationTask, options: dict[str, Any]) -> Row:
    """Bind, solve, drag the handles from rest to their targets and back, and change the handles.

    Parameters
    ----------
    task : DeformationTask
    options : dict
        Arguments of :class:`sshade.Deformer` other than the handles.

    Returns
    -------
    dict
        Times in seconds:

        - ``seconds.bind``; ``seconds.first``: from rest to the targets at once, to the default tolerance;
        - ``seconds.step``, ``seconds.step_95``: median and 95th percentile of the steps to the targets;
        - ``seconds.step_solve``, ``seconds.step_carry``, ``seconds.step_output``: medians of the time of
          the proxy, of the mesh and of the rest of a step;
        - ``seconds.settle``: from the last step to the minimum;
        - ``seconds.rebind``: mean of removing the last group of handles and of adding it again.

        Largest distance of a vertex between two shapes, in % of the diagonal:

        - ``drag.first``: the first solve and its minimum;
        - ``drag.last``: the last step and the first solve;
        - ``drag.settled``: the minimum after the drag and the minimum of the first solve;
        - ``drag.return``: the end of the way back and the solution at rest.
    """
    handles, rest = task.handles, task.mesh.V[task.handles.index]
    begin = perf_counter()
    deformer = bound(task, options)
    ready = perf_counter()
    first = deformer.step(handles.target)
    solved = perf_counter()
    minimum = deformer.settle().vertices
    deformer.reset()
    before = deformer.step(rest, tolerance=TOLERANCE).vertices
    out = np.empty_like(before)
    path = [rest + number / STEPS * (handles.target - rest) for number in range(STEPS + 1)]
    forth = _timed_steps(deformer, path[1:], out)
    last = out.copy()
    start = perf_counter()
    deformer.settle(out=out)
    settling = perf_counter() - start
    settled = out.copy()
    _timed_steps(deformer, path[-2::-1], out)
    whole, solve, carry = np.median(forth, axis=0)
    seconds = {
        "bind": ready - begin,
        "first": solved - ready,
        "step": whole,
        "step_95": np.percentile(forth[:, 0], 95),
        "step_solve": solve,
        "step_carry": carry,
        "step_output": np.median(forth[:, 0] - forth[:, 1] - forth[:, 2]),
        "settle": settling,
        "rebind": _rebinding(deformer, task),
        "total": perf_counter() - begin,
    }
    shapes = {
        "first": (first.vertices, minimum),
        "last": (last, first.vertices),
        "settled": (settled, minimum),
        "return": (out, before),
    }
    row = {f"seconds.{name}": float(value) for name, value in seconds.items()}
    row["iterations"] = float(first.iterations)
    for name, (one, other) in shapes.items():
        row[f"drag.{name}"] = 100 * float(np.linalg.norm(one - other, axis=1).max()) / task.mesh.diagonal
    return row


def _timed_steps(deformer: Deformer, path: Sequence[np.ndarray], out: np.ndarray) -> np.ndarray:
    """Follow targets (h, 3); return the seconds (k, 3) of each step, of its solve and of its prolongation."""
    seconds = []
    for targets in path:
        begin = perf_counter()
        parts = deformer.step(targets, tolerance=TOLERANCE, out=out).seconds
        seconds.append((perf_counter() - begin, parts["solve"], parts["carry"]))
    return np.array(seconds)


def _rebinding(deformer: Deformer, task: DeformationTask) -> float:
    """Return the mean seconds of removing the last group of handles, if there are several, and adding it."""
    handles = task.handles
    fewer = handles.group != handles.group.max()
    begin = perf_counter()
    for kept in (fewer if fewer.any() else ~fewer, np.ones(len(handles), dtype=bool)):
        deformer.rebind(handles.index[kept], group=handles.group[kept], weight=handles.weight[kept])
    return (perf_counter() - begin) / 2


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
