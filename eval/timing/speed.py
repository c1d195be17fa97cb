"""Time calls of methods: complete calls, or a few iterations extrapolated to the cutoff."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter

from eval.metrics import Task
from eval.rows.store import Row
from eval.run.provenance import method_facts, task_facts
from eval.run.targets import code_of
from eval.timing.timed_cases import TimedCase, TimedMethod
from eval.timing.turns import Job, take_turns
from sshade.core.errors import InputError
from sshade.problem.task import DeformationResult


def time_methods(methods: Sequence[TimedMethod], cases: Sequence[TimedCase], *, rounds: int) -> list[Row]:
    """Time methods on tasks, in turns.

    Raises
    ------
    InputError
        As :func:`eval.timing.turns.take_turns`; and if a method to extrapolate counts no iterations.
    """
    tasks = [case.load() for case in cases]
    return take_turns([job_of(method, task) for task in tasks for method in methods], rounds=rounds)


def job_of(method: TimedMethod, task: Task) -> Job:
    """Return a job that calls a method on a task.

    A method with a block runs so many iterations only. Its rows hold the estimated time of
    ``max_iterations`` of the configuration.
    """
    facts, block = method_facts(method.label, method.config) | task_facts(task), method.block
    if block is None:
        return Job(facts, timed(method.on(task)), code_of(method.config))
    limit = method.config.get("max_iterations")
    if type(limit) is not int or "tolerance" not in method.config:
        raise InputError(f"--extrapolate needs max_iterations and tolerance, and {method.label} has none")
    if not 0 < block < limit:
        raise InputError(f"a block of {block} iterations does not fit {method.label}, whose limit is {limit}")
    short = method._replace(config=method.config | {"max_iterations": block, "tolerance": 0.0})
    call = timed(short.on(task))
    return Job(facts, lambda: extrapolate(call(), to=limit))


def timed(call: Callable[[], DeformationResult]) -> Callable[[], Row]:
    """Return a function that calls a method and returns the seconds of its stages and its iterations."""

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
    """Return a row with ``seconds.solve`` scaled from the measured iterations to `to` iterations.

    Raises
    ------
    InputError
        If the row has no iterations, or lacks ``seconds.solve``.
    """
    if not row["iterations"] or "seconds.solve" not in row:
        raise InputError("--extrapolate needs a method that reports iterations and the time of its solve")
    solve = row["seconds.solve"] * to / row["iterations"]
    return row | {
        "seconds.total": row["seconds.total"] - row["seconds.solve"] + solve,
        "seconds.solve": solve,
        "extrapolated_to": to,
        "converged": None,
    }
