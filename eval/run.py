"""One run: a method on a task becomes one row and one folder."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from eval.metrics import measure
from eval.provenance import config_hash, dependencies, digest, environment, source_hash, task_checksum
from eval.store import SCHEMA, VALID, Row, read_row, run_folder, write_run
from eval.targets import flat, instantiate, settings, target_modules
from eval.warmup import warm_up
from sshade.task import DeformationResult, DeformationTask, Progress, silent

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """A run and where it lies; `reused` if it was there already."""

    row: Row
    folder: Path
    reused: bool

    @property
    def failed(self) -> bool:
        """Whether the run counts as a failure for the exit code."""
        return self.row["status"] in ("failed", "timeout")


def run(
    task: DeformationTask,
    method: Mapping[str, Any],
    *,
    name: str,
    root: Path,
    seed: int = 0,
    source: Mapping[str, Any] | None = None,
    force: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> Outcome:
    """Run a method on a task, measure it and store the row; or find the row of an equal run.

    The clock runs around the method only. A method that raises leaves a row of
    status ``failed``; an extra that is not installed one of status ``skipped``.
    Such rows are run again next time, valid ones are not.

    Parameters
    ----------
    task : DeformationTask
    method : mapping
        Its configuration: ``_target_``, parameters, and optionally ``warm_up``,
        the parameters that shrink the untimed first run. ``warm_up: null``
        leaves that out.
    name : str
        The method's name in tables.
    root : path
        Folder of the experiment.
    seed : int
    source : mapping, optional
        Configuration that loads the task again, for figures.
    force : bool
        Run even if the row exists.
    jobs : int
        How many runs are executed at once.
    progress : Progress

    Raises
    ------
    InputError
        When the configuration names a function or a parameter that does not exist.
    """
    row = _identity(task, method, name=name, seed=seed, source=source)
    folder = run_folder(root, row)
    existing = None if force else read_row(folder)
    if existing is not None and existing["status"] in VALID:
        return Outcome(existing, folder, reused=True)

    begin = datetime.now(UTC)
    row |= {f"env.{fact}": value for fact, value in environment(jobs=jobs).items()}
    row |= {"date": begin.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "peak_mib": None}
    row |= {"status": "failed", "reason": "", "iterations": None, "converged": None}
    try:
        call = instantiate({**method, "_partial_": True})
    except ImportError as error:
        row |= {"status": "skipped", "reason": _sentence(error)}
        write_run(folder, row)
        return Outcome(row, folder, reused=False)
    vertices = None
    try:
        row["env.warmed_up"] = method.get("warm_up", {}) is not None
        if row["env.warmed_up"]:
            warm_up(call, dict(method.get("warm_up", {})), key=row["method.hash"])
        result, seconds = _timed(call, task, seed=seed, progress=progress)
        row |= _facts(result, seconds)
        row |= {f"metric.{metric}": value for metric, value in measure(task, result.vertices).items()}
        vertices = result.vertices
    except ImportError as error:
        row |= {"status": "skipped", "reason": _sentence(error)}
    except Exception as error:  # whatever a method raises belongs into its row; the sweep goes on
        log.debug("%s on %s", name, task.name, exc_info=True)
        row |= {"status": "failed", "reason": _sentence(error)}
    write_run(folder, row, vertices)
    return Outcome(row, folder, reused=False)


def _identity(
    task: DeformationTask,
    method: Mapping[str, Any],
    *,
    name: str,
    seed: int,
    source: Mapping[str, Any] | None,
) -> Row:
    """What is known before the run, with the key that an equal run would have."""
    plain = settings(method)
    row: Row = {"seed": seed, "schema": SCHEMA, "method.name": name, "method.hash": config_hash(plain)}
    row |= flat(plain, "method")
    row |= _task_facts(task)
    if source is not None:
        row["task.source"] = json.dumps(source)
    found = dependencies(*target_modules(method))
    row["method.sources"] = source_hash(found.sources)
    row |= {f"env.version.{library}": version for library, version in found.versions.items()}
    row["key"] = digest(
        config_hash({"method": plain, "seed": seed, "schema": SCHEMA, "versions": found.versions}).encode(),
        row["task.checksum"].encode(),
        row["method.sources"].encode(),
    )
    return row


def _task_facts(task: DeformationTask) -> Row:
    mesh, handles = task.mesh, task.handles
    facts = {
        "name": task.name,
        "checksum": task_checksum(task),
        "vertices": mesh.n,
        "faces": mesh.m,
        "closed": mesh.is_closed,
        "handles": len(handles),
        "dynamic": int(handles.dynamic.sum()),
        "merged": handles.merged,
        "snap_max": float(handles.snap_distance.max()) / mesh.diagonal,
    }
    facts |= {f"meta.{name}": value for name, value in task.meta.items() if _is_scalar(value)}
    return {f"task.{name}": value for name, value in facts.items()}


def _timed(
    call: Callable[..., DeformationResult], task: DeformationTask, *, seed: int, progress: Progress
) -> tuple[DeformationResult, float]:
    begin = perf_counter()
    result = call(task, seed=seed, progress=progress)
    seconds = perf_counter() - begin
    if np.shape(result.vertices) != task.mesh.V.shape:
        raise ValueError(f"returned vertices of shape {np.shape(result.vertices)}, not {task.mesh.V.shape}")
    return result, seconds


def _facts(result: DeformationResult, seconds: float) -> Row:
    row: Row = {
        "status": "not_converged" if result.converged is False else "ok",
        "iterations": float(result.iterations),
        "converged": None if result.converged is None else bool(result.converged),
        "seconds.total": seconds,
    }
    row |= {f"seconds.{stage}": float(value) for stage, value in result.seconds.items() if stage != "total"}
    row |= {f"extra.{name}": _plain(value) for name, value in result.extra.items() if _is_scalar(value)}
    return row


def _is_scalar(value: Any) -> bool:
    return value is None or isinstance(value, (bool, int, float, str, np.generic))


def _plain(value: Any) -> Any:
    """A Python scalar that JSON knows: no numpy types, None for NaN and infinities."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _sentence(error: BaseException) -> str:
    """The error on one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
