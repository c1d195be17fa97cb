"""Invented rows of runs, for tests of tables, charts and reports."""

from typing import Any

import pandas as pd

from eval.publish.summary import Table, make_table
from eval.rows.frame import to_frame
from eval.rows.store import Row

#: Columns that are empty in the row of a run without a result.
NOTHING: Row = {"iterations": None, "converged": None, "seconds.total": None} | {
    f"metric.{name}": None for name in ("volume", "area", "edge", "angle", "handle")
}


def row(method: str = "a", task: str = "t1", **changes: Any) -> Row:
    """Return a row of a method on a task; ``metric__volume=2.0`` changes ``metric.volume``."""
    values = {
        "method.name": method,
        "method.hash": method,
        "task.name": task,
        "task.checksum": "c",
        "task.vertices": 1000,
        "seed": 0,
        "date": "2026-01-01",
        "key": f"{method} {task}",
        "status": "ok",
        "reason": "",
        "iterations": 10.0,
        "converged": True,
        "metric.volume": 1.0,
        "metric.area": 2.0,
        "metric.edge": 3.0,
        "metric.angle": 4.0,
        "metric.handle": 0.0,
        "seconds.total": 5.0,
        "env.machine": "box",
        "env.commit": "abcdef0123456789",
        "env.modified": False,
        "method.version": 1,
        "measures": 1,
    }
    return {**values, **{name.replace("__", "."): value for name, value in changes.items()}}


def lost(method: str, task: str = "t1", *, status: str = "failed", reason: str = "ValueError: no") -> Row:
    """Return the row of a run without a result."""
    return row(method, task, status=status, reason=reason) | NOTHING


def missing(method: str, task: str = "t1", *, seed: int = 0) -> Row:
    """Return the row that stands for a missing run."""
    run = {"method.name": method, "task.name": task, "seed": seed}
    return run | {"status": "missing", "reason": "never run"}


def frame(*rows: Row) -> pd.DataFrame:
    """Return the rows as a data frame, from which tables are made."""
    return to_frame(rows)


def table_of(*rows: Row, **options: Any) -> Table:
    """Return the table of the rows, with the title t."""
    return make_table(frame(*rows), title="t", **options)
