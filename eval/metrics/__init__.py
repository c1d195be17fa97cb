"""Metrics of deformed meshes."""

from eval.metrics import deformation  # noqa: F401 - registers the metrics
from eval.metrics.deformed import METRICS, Deformed, Metric, Task, measure

#: Version of the measures, part of every row and its key. Raise it when a value of a measure changes. A new
#: measure changes no value: it leaves the version, and rows made before it lack its column.
MEASURES = 1

__all__ = ["MEASURES", "METRICS", "Deformed", "Metric", "Task", "measure"]
