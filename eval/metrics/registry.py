"""The registry of metrics: pure functions of a task and of the deformed vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eval.metrics.deformed import Deformed, Task

Function = Callable[[Deformed], float]
Needs = Literal["handles", "truth", "posed"]


@dataclass(frozen=True)
class Metric:
    """A number that describes a deformation.

    Parameters
    ----------
    name : str
        The column in a row is ``metric.<name>``.
    unit : str
        ``%``, ``deg``, ``count``, or ``-`` for none.
    equation : str
        Definition in one line, for the legend of a table.
    function : callable
        ``Deformed -> float``, NaN if not available.
    needs : tuple of {"handles", "truth", "posed"}
        Attributes that a task must have. Rows of other tasks lack the column.
    """

    name: str
    unit: str
    equation: str
    function: Function
    needs: tuple[Needs, ...] = ()


#: All metrics by name, in the order of rows and legends.
METRICS: dict[str, Metric] = {}


def metric(unit: str, equation: str, *needs: Needs) -> Callable[[Function], Function]:
    """Register a function as a metric under its name; :class:`Metric` describes the arguments."""

    def register(function: Function) -> Function:
        METRICS[function.__name__] = Metric(function.__name__, unit, equation, function, needs)
        return function

    return register


def measure(task: Task, vertices: np.ndarray) -> dict[str, float | None]:
    """Compute all metrics that apply to a task; None if a value is not available, or infinite.

    Parameters
    ----------
    task : DeformationTask or TransferTask
    vertices : (n, 3) float
        M', in the numbering of the task's mesh.
    """
    deformed = Deformed(task, vertices)
    values = {
        name: float(metric.function(deformed))
        for name, metric in METRICS.items()
        if all(getattr(task, fact, None) is not None for fact in metric.needs)
    }
    return {name: value if np.isfinite(value) else None for name, value in values.items()}
