"""Run a method on a task; the result is one row and one folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter, time
from typing import Any, NamedTuple

from eval.metrics import Task, measure
from eval.rows.csv_rows import published_row
from eval.rows.files import copy_file
from eval.rows.store import SCHEMA, TRANSFER, VALID, Row, read_row, run_folder, write_run
from eval.run.attempt import NOTHING, Attempt, attempt, attempt_fresh, is_scalar
from eval.run.code import METRICS, code_version, digest, require_unchanged
from eval.run.provenance import config_hash, environment, library_versions, method_facts, task_facts
from eval.run.targets import code_of, instantiate, require_kind, settings
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.task import DeformationTask

#: Largest difference between the system's clock and a steady clock: in seconds, and as a fraction of the run.
CLOCK_TOLERANCE = 1.0, 1e-3


class Outcome(NamedTuple):
    """Result of :func:`run`.

    Attributes
    ----------
    row : dict
    folder : Path
        Folder of the run. A published row may be without a folder.
    found : str
        "already there" or "already published" for an earlier row, "" for a new row.
    """

    row: Row
    folder: Path
    found: str = ""

    @property
    def failed(self) -> bool:
        """Whether the run counts as a failure for the exit code."""
        return self.row["status"] in ("failed", "timeout")


def run(
    task: Task,
    method: Mapping[str, Any],
    *,
    name: str,
    root: Path,
    seed: int = 0,
    source: Mapping[str, Any] | None = None,
    shared: Path | None = None,
    force: bool = False,
    fresh: bool = False,
    time_limit: float | None = None,
    jobs: int = 1,
    progress: Progress = silent,
) -> Outcome:
    """Run a method on a task, measure the result and store the row, unless an equal run has a row.

    An equal run has the same key, which includes the version of the code. Its row is in `root`, or published
    in ``results/rows`` below the current folder. The clock times the method only.

    A method that raises leaves a row with status ``failed``. A method whose extra is not installed leaves a
    row with status ``skipped``. Both are run again next time. A row with status ``timeout`` is run again with
    a longer limit only.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    method : mapping
        Configuration of the method: ``_target_`` and parameters. ``warm_up`` has the parameters that shrink
        the untimed first run; ``warm_up: null`` omits the first run. ``note`` is a sentence for tables. The
        key includes neither ``warm_up`` nor ``note``.
    name : str
        Name of the method in tables.
    root : path
        Folder of the experiment; its last part is the name of the experiment.
    seed : int
    source : mapping, optional
        Configuration that loads the task again, for figures.
    shared : path, optional
        Folder of another experiment, whose equal runs are copied.
    force : bool
        Run even if a row exists.
    fresh : bool
        Run in a new process, which also measures ``peak_mib``.
    time_limit : float, optional
        Longest time in seconds, after which the status is ``timeout``; implies `fresh`.
    jobs : int
        Number of runs that are executed at once.
    progress : Progress

    Raises
    ------
    InputError
        When the configuration names an unknown function or parameter, or a method for another kind of task;
        when the system's clock jumped during the run.
    CodeChanged
        When the code has changed since this process began. The run leaves no row.
    """
    functions = code_of(method) | code_of(source or {})
    require_unchanged(functions)
    can_run = True
    try:
        call = instantiate({**method, "_partial_": True})  # raises on a mistake in the configuration
        require_kind(call, task, target=method["_target_"])
    except ImportError:
        can_run = False  # the run will be skipped, which needs no new process
    row = _identity(task, method, name=name, seed=seed, source=source)
    folder = run_folder(root, row)
    if shared is not None and not force:
        _copy_run(run_folder(shared, row), folder)
    fresh = fresh or time_limit is not None
    found = None if force else _find(folder, root.name, row, fresh=fresh, time_limit=time_limit)
    if found is not None:
        return found
    row |= {f"env.{fact}": value for fact, value in environment(jobs=jobs).items()}
    row |= {"date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "peak_mib": None}
    row["env.time_limit"] = time_limit
    clock, steady = time(), perf_counter()
    if fresh and can_run:
        done = attempt_fresh(method, task, seed=seed, time_limit=time_limit, progress=progress)
    else:
        done = attempt(method, task, seed=seed, progress=progress)
    if done.vertices is not None:
        progress("metrics", 0, 1)
        try:
            row |= {f"metric.{metric}": value for metric, value in measure(task, done.vertices).items()}
        except InputError as error:  # the method's mistake, not the user's
            done = Attempt(NOTHING | {"reason": str(error)})
        progress("metrics", 1, 1)
    row |= done.facts
    _check_clock(time() - clock, perf_counter() - steady, row)
    require_unchanged(functions)  # methods import modules while they run
    write_run(folder, row, vertices=done.vertices, curves=done.curves)
    return Outcome(row, folder)


def _copy_run(run: Path, folder: Path) -> None:
    """Copy a valid run to a folder without a valid run. The row is copied last and marks a complete run."""
    found, stored = read_row(run), read_row(folder)
    if found is None or found["status"] not in VALID or (stored is not None and stored["status"] in VALID):
        return
    for name in ("vertices.npy", "curves.npz", "row.json"):
        if (run / name).is_file():
            copy_file(run / name, folder / name)


def _find(
    folder: Path, experiment: str, row: Row, *, fresh: bool, time_limit: float | None
) -> Outcome | None:
    """Return an equal run whose row can be used, or None."""
    stored = read_row(folder)
    if stored is not None and _usable(stored, fresh=fresh, time_limit=time_limit):
        return Outcome(stored, folder, found="already there")
    published = published_row(experiment, row)
    if published is None or published["env.version.metrics"] != row["env.version.metrics"]:
        return None
    usable = _usable(published, fresh=fresh, time_limit=time_limit)
    return Outcome(published, folder, found="already published") if usable else None


def _check_clock(by_clock: float, passed: float, row: Row) -> None:
    """Raise InputError if the system's clock jumped during a run."""
    seconds, fraction = CLOCK_TOLERANCE
    if abs(by_clock - passed) > max(seconds, fraction * passed):
        raise InputError(
            f"the system's clock went {by_clock:.1f} s while {passed:.1f} s passed in the run of "
            f"{row['method.name']} on {row['task.name']}: it was set, or the machine slept; run it again"
        )


def _usable(row: Row, *, fresh: bool, time_limit: float | None) -> bool:
    """Whether an earlier row makes a run unnecessary."""
    if row["status"] == "timeout":
        return time_limit is not None and row["env.time_limit"] >= time_limit
    return row["status"] in VALID and not (fresh and row["peak_mib"] is None)


def _identity(
    task: Task, method: Mapping[str, Any], *, name: str, seed: int, source: Mapping[str, Any] | None
) -> Row:
    """Return the columns that are known before the run, with the key."""
    row = method_facts(name, method) | task_facts(task) | {"seed": seed, "schema": SCHEMA}
    if "note" in method:
        row["method.note"] = " ".join(method["note"].split())
    row["task.closed"] = task.mesh.is_closed
    if isinstance(task, DeformationTask):
        handles = task.handles
        row |= {"task.handles": len(handles), "task.dynamic": int(handles.dynamic.sum())}
        row["task.merged"] = handles.merged
        row["task.snap_max"] = float(handles.snap_distance.max()) / task.mesh.diagonal
    else:
        row["task.kind"] = TRANSFER
    row |= {f"task.meta.{name}": value for name, value in task.meta.items() if is_scalar(value)}
    if source is not None:
        row["task.source"] = json.dumps(source)
    data = code_of(source or {})
    row["env.version.code"] = code_version(code_of(method) | data)
    row["env.version.evaluator"] = code_version(data)
    row["env.version.metrics"] = METRICS  # not in the key: stored vertices are measured again
    choices = {"method": settings(method), "seed": seed, "schema": SCHEMA}
    choices["versions"] = library_versions(code_of(method))
    parts = config_hash(choices), row["task.checksum"], row["env.version.code"]
    return row | {"key": digest(*(part.encode() for part in parts))}
