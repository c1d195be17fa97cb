"""Plans: the runs that sweeps of an experiment will do.

The process that begins a sweep writes a file ``<runs>/<experiment>/.plan/<hash of the runs>.json`` before
the first run. A planned run consists of the label of the method, the seed and the source of the task, so rows
from any launcher and published rows can be matched with it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from eval.rows.files import PLANS, write_text
from eval.rows.store import MISSING, Row
from sshade.core.errors import InputError

#: Columns of a planned run, and their types.
_FACTS = {"method.name": str, "seed": int, "task.source": str}


def write_plan(experiment: Path, runs: Sequence[Row]) -> None:
    """Write the planned runs of a sweep; an earlier plan of the same runs is replaced.

    Parameters
    ----------
    experiment : path
        Folder of the experiment's runs.
    runs : sequence of mapping
        Each with ``method.name``, ``seed``, ``task.source`` and the two columns of
        :func:`eval.rows.store.version_of`.
    """
    facts = json.dumps([[run[name] for name in _FACTS] for run in runs])
    path = experiment / PLANS / f"{hashlib.sha256(facts.encode()).hexdigest()[:16]}.json"
    # The time of the last change of a file is lost where the folder is copied.
    write_text(path, json.dumps({"runs": runs, "date": datetime.now(UTC).isoformat()}))


def read_plans(experiment: Path) -> list[Row]:
    """Return the planned runs of an experiment's sweeps, oldest plan first; none before its first sweep.

    Raises
    ------
    InputError
        When a file there is damaged.
    """
    plans = [_read(path) for path in sorted(experiment.glob(f"{PLANS}/*.json"))]
    return [run for plan in sorted(plans, key=lambda plan: plan["date"]) for run in plan["runs"]]


def _read(path: Path) -> dict[str, Any]:
    try:
        plan: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if any(type(run[name]) is not kind for run in plan["runs"] for name, kind in _FACTS.items()):
            raise TypeError("a run that is none")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{path}: not a plan ({type(error).__name__}: {error}); remove it, and the sweep, begun again, "
            "writes it"
        ) from error
    return {"date": datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat()} | plan


def run_of(row: Row) -> tuple[Any, ...]:
    """Return what a row and its planned run have in common, wherever the dataset was."""
    return row["method.name"], row["seed"], _case(row)


def forget_plans(experiment: Path) -> None:
    """Remove the plans, but no rows."""
    shutil.rmtree(experiment / PLANS, ignore_errors=True)


def missing_rows(planned: Iterable[Row], rows: Iterable[Row]) -> list[Row]:
    """Return a row with status ``missing`` for each planned run without a row.

    The name of a task comes from a row of the same case. Without such a row, the settings that load the task
    replace its name.

    Parameters
    ----------
    planned : iterable of mapping
        Planned runs, or rows with status ``missing``.
    rows : iterable of mapping
    """
    rows = list(rows)
    names = {_case(row): row["task.name"] for row in rows}
    known = {_dataset(row): row for row in rows if _dataset(row)}
    done = {(row["method.name"], row["task.name"], row["seed"]) for row in rows}
    missing = {}
    for run in planned:
        case = _case(run)
        name = names.get(case) or run.get("task.name") or _name_like(known.get(_dataset(run)), run) or case
        run_of = (run["method.name"], name, run["seed"])
        if run_of not in done:
            facts = {"task.name": name, "status": MISSING, "reason": "planned, never run"}
            facts["task.meta.subject"] = _source(run).get("subject")
            missing[run_of] = {fact: run.get(fact) for fact in _FACTS} | facts
    return list(missing.values())


def _case(run: Row) -> str:
    """Return the settings that load a task as text, without the folder: copies of a dataset share cases."""
    settings = " ".join(f"{name}={value}" for name, value in _source(run).items() if name != "root")
    return settings or run.get("task.source") or run["task.name"]


def _source(run: Row) -> dict[str, Any]:
    """Return the settings that load a task; none if they are missing or damaged."""
    try:
        source = json.loads(run.get("task.source") or "")
    except ValueError:
        return {}
    return source if isinstance(source, dict) else {}


def _dataset(run: Row) -> str:
    """Return the settings of a run's dataset as text; empty without subject and pose."""
    source = _source(run)
    if not {"subject", "pose"} <= set(source):
        return ""
    return json.dumps({name: value for name, value in source.items() if name not in ("subject", "pose")})


def _name_like(row: Row | None, run: Row) -> str:
    """Return the name of a run's task, by the name of another task of its dataset; empty if it has none."""
    if row is None:
        return ""
    own, other = _source(run), _source(row)
    beginning, _, rest = row["task.name"].partition(f"subject_{other['subject']:02}/pose_{other['pose']}")
    named = row["task.name"] != beginning and not rest[:1].isdigit()
    return f"{beginning}subject_{own['subject']:02}/pose_{own['pose']}{rest}" if named else ""
