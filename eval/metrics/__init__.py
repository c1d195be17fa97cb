"""What is measured of a deformed mesh."""

from eval.metrics import deformation, truth  # noqa: F401 - which fill the registry, in this order
from eval.metrics.registry import METRICS, Metric, Task, measure

__all__ = ["METRICS", "Metric", "Task", "measure"]
