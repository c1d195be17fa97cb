"""Calls of methods to time, whose results are measured."""

from __future__ import annotations

import numpy as np

from eval.bench.cases import HAIR, TimedCase, TimedMethod, moved
from eval.bench.quality import COMPARED, require_quality
from eval.bench.turns import Job
from eval.metrics import MEASURES, Task, measure
from eval.rows.store import Row
from eval.run.attempt import attempt
from eval.run.config import with_truth
from eval.run.environment import digest, method_facts, task_facts
from eval.run.fresh import attempt_fresh
from eval.run.targets import is_ours
from sshade.core.errors import InputError

#: Number of iterations from which the time of all iterations is estimated.
BLOCK = 10


class Calls:
    """Calls of a method on a task; an extrapolated method runs :data:`BLOCK` of its iterations.

    No call can use what another one has left: its meshes are new, and its targets are its own. Methods of
    others run in new processes.
    """

    def __init__(self, method: TimedMethod, task: Task, case: TimedCase) -> None:
        self.label = method.label
        self.config = method.config
        self.limit = 0
        self.task = task
        self.case = case
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
