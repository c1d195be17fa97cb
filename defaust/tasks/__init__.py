"""From a DeFAUST folder to deformation and transfer tasks."""

from defaust.tasks.load import TaskId, list_tasks, load_task

__all__ = ["TaskId", "list_tasks", "load_task"]
