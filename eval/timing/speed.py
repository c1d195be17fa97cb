"""Calls of methods on tasks, whole or extrapolated from some of their iterations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from time import perf_counter
from typing import Any

from eval.metrics import Task
from eval.rows.store import Row
from eval.run.targets import instantiate
from eval.timing.cases import TimedMethod, task_facts
from eval.timing.turns import Job, take_turns
from sshade.errors import InputError
from sshade.task import DeformationResult

#: What these rows are of.
KIND = "speed"


def time_methods(
    methods: Sequence[TimedMethod],
    sources: Sequence[dict[str, Any]],
    *,
    rounds: int,
    extrapolated: Collection[str] = (),
    block: int = 10,
) -> list[Row]:
    """Time methods on tasks in turns.

    Parameters
    ----------
    methods : sequence of TimedMethod
    sources : sequence of dict
        Configurations that load the tasks.
    rounds : int
    extrapolated : collection of str
        Labels of methods of which only `block` iterations run; their rows hold what the cutoff
        ``max_iterations`` of their configuration would take.
    block : int

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`; and when a method to be extrapolated is not among
        them, or counts no iterations.
    """
    unknown = [label for label in extrapolated if label not in {method.label for method in methods}]
    if unknown:
        raise InputError(f"{unknown[0]} is to be extrapolated, but is none of the methods")
    tasks = [instantiate(source) for source in sources]
    jobs = [
        job_of(method, task, block=block if method.label in extrapolated else None)
        for task in tasks
        for method in methods
    ]
    return take_turns(jobs, rounds=rounds)


def job_of(method: TimedMethod, task: Task, *, block: int | None = None) -> Job:
    """A job that calls a method on a task; with `block`, for so many of its iterations."""
    facts = {"kind": KIND} | method.facts | task_facts(task)
    if block is None:
        return Job(facts, whole(method.on(task)))
    limit = method.config.get("max_iterations")
    if type(limit) is not int or "tolerance" not in method.config:
        raise InputError(
            f"{method.label} cannot be extrapolated: its configuration has no max_iterations and tolerance"
        )
    if not 0 < block < limit:
        raise InputError(
            f"a block of {block} iterations does not fit {method.label}, whose cutoff is {limit}"
        )
    call = method.with_parameters(max_iterations=block, tolerance=0.0).on(task)
    return Job(facts, lambda: extrapolate(whole(call)(), to=limit))


def whole(call: Callable[[], DeformationResult]) -> Callable[[], Row]:
    """A call that gives the seconds of its stages and the iterations."""

    def run() -> Row:
        begin = perf_counter()
        result = call()
        total = perf_counter() - begin
        stages = {f"seconds.{name}": value for name, value in result.seconds.items() if name != "total"}
        return stages | {
            "seconds.total": total,
            "iterations": float(result.iterations),
            "converged": None if result.converged is None else bool(result.converged),
        }

    return run


def extrapolate(row: Row, *, to: int) -> Row:
    """What a run would take for `to` iterations, of which `row` has some in ``seconds.solve``.

    Raises
    ------
    InputError
        When the method ran no iteration, or does not say how long they took.
    """
    if not row["iterations"] or "seconds.solve" not in row:
        raise InputError(
            "a method cannot be extrapolated that does not tell its iterations and the seconds of `solve`"
        )
    solve = row["seconds.solve"] * to / row["iterations"]
    return row | {
        "seconds.total": row["seconds.total"] - row["seconds.solve"] + solve,
        "seconds.solve": solve,
        "extrapolated_to": to,
        "converged": None,
    }
