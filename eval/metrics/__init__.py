"""Metrics of deformed meshes."""

from eval.metrics import deformation, distortion, creases, detail, truth  # noqa: F401, I001 - the registry's order
from eval.metrics.deformed import Deformed, Task
from eval.metrics.registry import METRICS, Metric, measure

__all__ = ["METRICS", "Deformed", "Metric", "Task", "measure"]
