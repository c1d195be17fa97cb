"""Metrics of deformed meshes."""

from eval.metrics import deformation, creases, truth  # noqa: F401, I001 - the registry's order
from eval.metrics.deformed import Deformed, Task
from eval.metrics.registry import METRICS, Metric, measure

#: Version of the measures, part of every row and its key. Raise it when a value of a measure changes. A new
#: measure changes no value: it leaves the version, and rows made before it lack its column.
MEASURES = 1

__all__ = ["MEASURES", "METRICS", "Deformed", "Metric", "Task", "measure"]
