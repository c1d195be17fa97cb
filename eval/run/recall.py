"""Load the task of a stored row again."""

from __future__ import annotations

import json

from eval.metrics import Task
from eval.rows.store import Row
from eval.run.allowed import require_allowed
from eval.run.provenance import task_checksum
from eval.run.targets import instantiate
from sshade.errors import InputError


def load_task(row: Row) -> Task:
    """Load the task of a row from its dataset.

    Raises
    ------
    InputError
        When the row does not name the source of its task, or the dataset is missing or has changed.
    """
    if not row.get("task.source"):
        raise InputError(
            f"the row of {row['task.name']} has no task.source, which loads its task; run it again"
        )
    try:
        source = json.loads(row["task.source"])
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"the row of {row['task.name']} has a task.source that is not JSON ({error}); run it again"
        ) from error
    require_allowed(source, where=f"the row of {row['task.name']}")
    task = instantiate(source)
    if task_checksum(task) != row["task.checksum"] or task.mesh.n != row["task.vertices"]:
        raise InputError(f"the dataset of {row['task.name']} has changed since the run; run it again")
    return task
