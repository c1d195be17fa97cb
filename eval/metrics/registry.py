"""The registry of metrics: pure functions of a task and of the deformed vertices."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eval.metrics.deformed import Deformed, Task

Function = Callable[[Deformed], float]
Needs = Literal["handles", "truth", "posed"]


@dataclass(frozen=True)
class Metric:
    """One number about a deformation.

    Parameters
    ----------
    name : str
        Its column in a row is ``metric.<name>``.
    unit : str
        ``%``, ``deg``, ``count``, or ``-`` for none.
    equation : str
        The definition in one line, for the legend of a table.
    function : callable
        ``Deformed -> float``, NaN where not available.
    needs : tuple of {"handles", "truth", "posed"}
        What a task must have besides its mesh; the others have no such column.
    better : {"lower"}
        Which way is better.
    """

    name: str
    unit: str
    equation: str
    function: Function
    needs: tuple[Needs, ...] = ()
    better: Literal["lower"] = "lower"


#: Every metric by its name, in the order of rows and legends.
METRICS: dict[str, Metric] = {}


def metric(unit: str, equation: str, *needs: Needs) -> Callable[[Function], Function]:
    """Put a function into the registry under its own name; the arguments are those of :class:`Metric`."""

    def register(function: Function) -> Function:
        METRICS[function.__name__] = Metric(function.__name__, unit, equation, function, needs)
        return function

    return register


def measure(
    task: Task, vertices: np.ndarray, *, only: Collection[str] = METRICS.keys()
) -> dict[str, float | None]:
    """Every metric whose needs the task meets, None where its value is not available.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    vertices : (n, 3) float
        M', in the numbering of the task's mesh.
    only : collection of str
        Names of the metrics; all of them unless told.
    """
    deformed = Deformed(task, vertices)
    values = {
        name: float(metric.function(deformed))
        for name, metric in METRICS.items()
        if name in only and all(getattr(task, fact, None) is not None for fact in metric.needs)
    }
    return {name: value if np.isfinite(value) else None for name, value in values.items()}
