"""Load the task of a stored row again, and measure stored vertices again."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from eval.metrics import Task, measure
from eval.rows.store import Row, read_vertices
from eval.run.provenance import task_checksum
from eval.run.targets import instantiate
from sshade.core.errors import InputError
from sshade.core.progress import Progress
from sshade.files.atomic import naming


def task_of(source: Mapping[str, Any]) -> Task:
    """Call the function of a dataset's configuration; return its task.

    Raises
    ------
    InputError
        When the dataset is missing, or the function returns no task.
    """
    task = instantiate(source)
    if not isinstance(task, Task):
        raise InputError(f"{source['_target_']} returns a {type(task).__name__}, and no task")
    return task


def load_task(row: Row) -> Task:
    """Load the task of a row from its dataset.

    Raises
    ------
    InputError
        When the row does not name the source of its task, or the dataset is missing or has changed.
    """
    if not row.get("task.source"):
        raise InputError(f"the row of {row['task.name']} has no task.source to load its task; run it again")
    try:
        source = json.loads(row["task.source"])
    except (ValueError, RecursionError) as error:
        name = row["task.name"]
        raise InputError(f"the task.source of {name} is not JSON ({error}); run it again") from error
    task = task_of(source)
    if task_checksum(task) != row["task.checksum"] or task.mesh.n != row["task.vertices"]:
        raise InputError(
            f"the dataset of {row['task.name']} has changed since the run; run it again, and remove this run"
        )
    return task


def measured_again(
    runs: Iterable[tuple[Row, Path]], *, stage: str, progress: Progress
) -> Iterator[tuple[Row, Path, dict[str, float | None]]]:
    """Yield each row with its run folder and the measures of its stored vertices. Each task is loaded once.

    Raises
    ------
    InputError
        When the dataset of a run has changed, or its vertices are missing.
    """
    runs = sorted(runs, key=lambda pair: (pair[0]["task.name"], pair[0]["task.checksum"]))
    last: tuple[str, str] | None = None
    for done, (row, folder) in enumerate(runs):
        name = row["task.name"]
        progress(stage, done, len(runs), name)
        if last != (name, row["task.checksum"]):
            with naming(folder):
                last, task = (name, row["task.checksum"]), load_task(row)
        yield row, folder, measure(task, read_vertices(folder, n=row["task.vertices"]))
