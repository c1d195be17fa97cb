"""One run: a method on a task becomes one row and one folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter, time
from typing import Any

from eval.metrics import Task, measure
from eval.rows.csv_rows import published_row
from eval.rows.store import SCHEMA, TRANSFER, VALID, Row, read_row, run_folder, write_run
from eval.run.attempt import attempt, attempt_fresh, is_scalar
from eval.run.code import METRICS, code_version, digest, require_unchanged
from eval.run.provenance import config_hash, environment, library_versions, task_checksum
from eval.run.shared import take_along
from eval.run.targets import flat, instantiate, require_kind, settings, target_functions
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.task import DeformationTask

#: Seconds, and share of a run's time, that the system's clock and a steady one may differ by.
CLOCK_TOLERANCE = 1.0, 1e-3


@dataclass(frozen=True)
class Outcome:
    """A run, its folder, and where its row was found: "already there", "already published", "" for a new one.

    A published row need not have the folder.
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
    """Run a method on a task, measure it and store the row; or find the row of an equal run.

    An equal run has the same key, the version of the code in it. It may lie in
    `root`, or be published in ``results/rows`` beside the command.
    The clock runs around the method only. A method that raises leaves a row of
    status ``failed``; an extra that is not installed one of status ``skipped``.
    Such rows are run again next time; valid ones are not, nor those that met a
    time limit as long as this one.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    method : mapping
        Its configuration: ``_target_``, parameters, and optionally ``warm_up``,
        the parameters that shrink the untimed first run (``warm_up: null``
        leaves that out), and ``note``, a sentence that tables show. Neither is
        part of the key: a kept row keeps the note that it was written with.
    name : str
        The method's name in tables.
    root : path
        Folder of the experiment, by its name.
    seed : int
    source : mapping, optional
        Configuration that loads the task again, for figures.
    shared : path, optional
        Folder of another experiment, whose equal runs are taken along.
    force : bool
        Run even if the row exists.
    fresh : bool
        Run in a process of its own, which measures ``peak_mib``.
    time_limit : float, optional
        Seconds after which the run is given up with status ``timeout``; implies `fresh`.
    jobs : int
        How many runs are executed at once.
    progress : Progress

    Raises
    ------
    InputError
        When the configuration names a function or a parameter that does not exist,
        or a method for another kind of task; when the system's clock jumped during the run.
    CodeChanged
        When files of the code are no longer those that this process began with; the run leaves nothing.
    """
    functions = target_functions(method) | target_functions(source or {})
    require_unchanged(functions)
    try:
        call = instantiate({**method, "_partial_": True})  # a mistake in the configuration ends here
        require_kind(call, task, target=method["_target_"])
    except ImportError:
        can_run = False  # to be skipped, which needs no process of its own
    else:
        can_run = True
    row = _identity(task, method, name=name, seed=seed, source=source)
    folder = run_folder(root, row)
    if shared is not None and not force:
        take_along(run_folder(shared, row), folder)
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
    row |= done.facts
    if done.vertices is not None:
        progress("metrics", 0, 1)
        row |= {f"metric.{metric}": value for metric, value in measure(task, done.vertices).items()}
        progress("metrics", 1, 1)
    _check_clock(time() - clock, perf_counter() - steady, row)
    require_unchanged(functions)  # methods import modules while they run
    write_run(folder, row, vertices=done.vertices, curves=done.curves)
    return Outcome(row, folder)


def _find(
    folder: Path, experiment: str, row: Row, *, fresh: bool, time_limit: float | None
) -> Outcome | None:
    """An equal run that answers what is asked."""
    stored = read_row(folder)
    if stored is not None and _settled(stored, fresh=fresh, time_limit=time_limit):
        return Outcome(stored, folder, found="already there")
    published = published_row(experiment, row["key"])
    if (
        published is not None
        and published["env.version.metrics"] == row["env.version.metrics"]
        and _settled(published, fresh=fresh, time_limit=time_limit)
    ):
        return Outcome(published, folder, found="already published")
    return None


def _check_clock(by_clock: float, passed: float, row: Row) -> None:
    """Raise InputError where the system's clock did not run as the seconds passed."""
    least, share = CLOCK_TOLERANCE
    if abs(by_clock - passed) > max(least, share * passed):
        raise InputError(
            f"the system's clock went {by_clock:.1f} s while {passed:.1f} s passed in the run of "
            f"{row['method.name']} on {row['task.name']}: it was set, or the machine slept; run it again"
        )


def _settled(row: Row, *, fresh: bool, time_limit: float | None) -> bool:
    """Whether a stored row answers what is asked."""
    if row["status"] == "timeout":
        return time_limit is not None and row["env.time_limit"] >= time_limit
    return row["status"] in VALID and not (fresh and row["peak_mib"] is None)


def _identity(
    task: Task, method: Mapping[str, Any], *, name: str, seed: int, source: Mapping[str, Any] | None
) -> Row:
    """What is known before the run, with the key that an equal run would have."""
    plain = settings(method)
    row: Row = {"seed": seed, "schema": SCHEMA, "method.name": name, "method.hash": config_hash(plain)}
    row |= flat(plain, "method")
    if "note" in method:
        row["method.note"] = " ".join(method["note"].split())
    row |= _task_facts(task)
    if source is not None:
        row["task.source"] = json.dumps(source)
    data = target_functions(source or {})
    row["env.version.code"] = code_version(target_functions(method) | data)
    row["env.version.evaluator"] = code_version(data)
    versions = library_versions(target_functions(method))
    row |= {f"env.version.{library}": version for library, version in versions.items()}
    row["env.version.metrics"] = METRICS  # not in the key: metrics are measured again from stored vertices
    row["key"] = digest(
        config_hash({"method": plain, "seed": seed, "schema": SCHEMA, "versions": versions}).encode(),
        row["task.checksum"].encode(),
        row["env.version.code"].encode(),
    )
    return row


def _task_facts(task: Task) -> Row:
    mesh = task.mesh
    facts = {
        "name": task.name,
        "checksum": task_checksum(task),
        "vertices": mesh.n,
        "faces": mesh.m,
        "closed": mesh.is_closed,
    }
    if isinstance(task, DeformationTask):
        facts |= {
            "handles": len(task.handles),
            "dynamic": int(task.handles.dynamic.sum()),
            "merged": task.handles.merged,
            "snap_max": float(task.handles.snap_distance.max()) / mesh.diagonal,
        }
    else:
        facts["kind"] = TRANSFER
    facts |= {f"meta.{name}": value for name, value in task.meta.items() if is_scalar(value)}
    return {f"task.{name}": value for name, value in facts.items()}
