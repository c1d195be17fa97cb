"""Load deformation and transfer tasks from a DeFAUST folder."""

from defaust.tasks.load import TaskId, list_tasks, load_task

__all__ = ["TaskId", "list_tasks", "load_task"]
