"""The loop over rows: a configuration becomes a task, a method, times, measures, a row.

The method is given a copy of the task, without its name and its meta data. The truth is loaded when the
method has returned.
"""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eval.metrics import MEASURES, Task, measure
from eval.rows.splits import require_split
from eval.rows.store import (
    TRANSFER,
    TRUE_POSE,
    VALID,
    DamagedRun,
    Row,
    is_scalar,
    plain,
    read_row,
    require_vertices,
    run_folder,
    write_run,
)
from eval.run.attempt import NOTHING, Attempt, attempt
from eval.run.config import RunConfig, load_case, with_truth
from eval.run.environment import digest, environment, method_facts, task_checksum, task_facts
from eval.run.fresh import attempt_fresh
from eval.run.targets import is_ours
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, TransferTask

#: What stands in a row of a true pose in place of a method's configuration.
MEASURED = {"_target_": "eval.metrics.measure", "version": 1}


class Outcome(NamedTuple):
    """A row and the folder of its run; whether the row was there already."""

    row: Row
    folder: Path
    found: bool = False

    @property
    def failed(self) -> bool:
        """Whether the run counts as a failure for the exit code."""
        return self.row["status"] in ("failed", "timeout")


def run(config: RunConfig, *, jobs: int = 1, progress: Progress = silent) -> Outcome:
    """Run a method on a task, measure the result and store the row, unless the run has a row.

    The clock times the method only. A method that raises leaves a row with status ``failed``. A method whose
    extra is not installed leaves a row with status ``skipped``. Both are run again next time. A row with
    status ``timeout`` is run again with a longer limit only. A damaged row is made again, with a note.
    Methods that are not the project's run in a new process. The true pose of the case gets a row of its own.

    Parameters
    ----------
    config : RunConfig
    jobs : int
        Number of runs that are executed at once.
    progress : Progress

    Raises
    ------
    InputError
        When the dataset or the case is missing, or the case belongs to the other half of the benchmark; when
        the configuration names an unknown function or parameter, or a method for another kind of task.
    """
    progress("reading", 0, 1)
    task = load_case(config)
    progress("reading", 1, 1)
    if not config.dataset.get("tag"):  # a tagged dataset gets a separate table
        require_split(task.name, config.run.split)
    fresh = config.run.fresh or config.run.time_limit is not None or not is_ours(config.method)
    row = identity(config, task)
    folder = run_folder(config.runs, row)
    if not config.run.force and (stored := _stored(folder, config, task)) is not None:
        _store_true_pose(stored, config, jobs=jobs, progress=progress)
        return Outcome(stored, folder, found=True)
    row |= _circumstances(config, jobs=jobs)
    copied = given(task)
    if fresh:
        limit = config.run.time_limit
        done = attempt_fresh(config.method, copied, seed=config.seed, time_limit=limit, progress=progress)
    else:
        done = attempt(config.method, copied, seed=config.seed, progress=progress)
    task = with_truth(task, config.source)
    done = _measured(done, task, progress)
    given_settings = {name: row[name] for name in row if name.startswith("method.") and row[name] is not None}
    row |= meta_facts(task) | done.facts | given_settings
    write_run(folder, row, vertices=done.vertices)
    _store_true_pose(row, config, jobs=jobs, progress=progress)
    return Outcome(row, folder)


def _store_true_pose(row: Row, config: RunConfig, *, jobs: int, progress: Progress) -> None:
    """Measure the true pose of a row's case like a result, and store it, unless it is unknown or stored."""
    if row.get("metric.truth_distance") is None or row.get("task.kind") == TRANSFER:
        return
    own = config.run._replace(fresh=False, time_limit=None)
    config = config._replace(label=TRUE_POSE, method=MEASURED, seed=0, run=own)
    task = load_case(config)
    row = identity(config, task)
    folder = run_folder(config.runs, row)
    if _stored(folder, config, task) is None:
        task = with_truth(task, config.source)
        facts = {"status": "ok", "reason": "", "iterations": None, "converged": None}
        done = _measured(Attempt(facts, task.truth), task, progress)
        row |= _circumstances(config, jobs=jobs) | meta_facts(task) | done.facts
        write_run(folder, row, vertices=done.vertices)


def _circumstances(config: RunConfig, *, jobs: int) -> Row:
    """Return the columns that say where and when a row was made."""
    row = {f"env.{fact}": value for fact, value in environment(jobs=jobs).items()}
    row |= {"date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "peak_mib": None}
    return row | {"env.time_limit": config.run.time_limit}


def given(task: Task) -> Task:
    """Return what a method is given: meshes and arrays of its own, a hash as name, and no facts.

    What a method leaves in a mesh thus changes neither the measures nor the run of another method.
    """
    name = task_checksum(task)
    mesh = _anew(task.mesh)
    if isinstance(task, TransferTask):
        rest = mesh if task.rest is task.mesh else _anew(task.rest)
        return replace(task, name=name, mesh=mesh, rest=rest, posed=np.array(task.posed), meta={})
    handles, guess = deepcopy(task.handles), deepcopy(task.guess)
    return replace(task, name=name, mesh=mesh, handles=handles, guess=guess, meta={})


def _anew(mesh: Mesh) -> Mesh:
    """Return a mesh with arrays of its own, and without the properties that a mesh keeps."""
    return Mesh(np.array(mesh.V), np.array(mesh.F))


def identity(config: RunConfig, task: Task) -> Row:
    """Return the columns that are known before the run, with the key.

    The key is a hash of the method's function, options and version, the arrays of the task, the seed and the
    version of the measures.
    """
    row = method_facts(config.label, config.method) | task_facts(task) | {"seed": config.seed}
    row |= {"measures": MEASURES, "task.source": json.dumps(config.source)}
    if "note" in config.method:
        row["method.note"] = " ".join(config.method["note"].split())
    row["task.closed"] = task.mesh.is_closed
    if isinstance(task, DeformationTask):
        handles = task.handles
        row |= {"task.handles": len(handles), "task.dynamic": int(handles.dynamic.sum())}
        row["task.merged"] = handles.snapping.merged
        row["task.snap_max"] = float(handles.snapping.distance.max()) / task.mesh.diagonal
    else:
        row["task.kind"] = TRANSFER
    row |= meta_facts(task)
    parts = (row[name] for name in ("method.hash", "method.version", "task.checksum", "seed", "measures"))
    return row | {"key": digest(*(str(part).encode() for part in parts))}


def meta_facts(task: Task) -> Row:
    """Return the columns ``task.meta.*``."""
    return {f"task.meta.{name}": plain(value) for name, value in task.meta.items() if is_scalar(value)}


def _stored(folder: Path, config: RunConfig, task: Task) -> Row | None:
    """Return the stored row of a run if it makes a run unnecessary; say where it is damaged."""
    try:
        row = read_row(folder)
        if row is None:
            return None
        if row["status"] == "timeout":
            limit = config.run.time_limit
            return row if limit is not None and row["env.time_limit"] >= limit else None
        if row["status"] not in VALID:
            return None
        require_vertices(folder, n=task.mesh.n)
    except DamagedRun as error:
        say(f"note: {error}; it is run again")
        return None
    measured = not (config.run.fresh or config.run.time_limit is not None) or row["peak_mib"] is not None
    return row if measured else None


def _measured(done: Attempt, task: Task, progress: Progress) -> Attempt:
    """Add the measures of a result to its facts."""
    if done.vertices is None:
        return done
    progress("metrics", 0, 1)
    try:
        found = {f"metric.{name}": value for name, value in measure(task, done.vertices).items()}
    except InputError as error:  # the method's mistake, not the user's
        return Attempt(NOTHING | {"reason": str(error)})
    progress("metrics", 1, 1)
    return done._replace(facts={**done.facts, **found})
