"""Small deformation tasks with known answers, for the tests of `eval` and of the methods' contract."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from eval.metrics import Task
from eval.run.config import RunConfig, RunSettings
from eval.run.run import Outcome
from eval.run.run import run as run_config
from sshade import DeformationResult, DeformationTask, Mesh
from sshade.core.progress import silent
from tests.shapes import bumpy, end_handles


def run(
    task: Task,
    method: dict[str, Any],
    *,
    name: str,
    root: Path,
    seed: int = 0,
    source: dict[str, Any] | None = None,
    **settings: Any,
) -> Outcome:
    """Run a method on a task as `sshade-eval run` does; without a `source`, the task is kept in memory."""
    values = {"experiment": "e", "folder": "e", "split": None, "force": False, "fresh": False, "of": 1}
    values |= {"time_limit": None, **settings}
    if source is None:
        source = {"_target_": "eval_cases.kept_task", "key": id(task)}
        KEPT[id(task)] = task
    return run_config(RunConfig(name, method, source, seed, RunSettings(**values), root))


#: Tasks of :func:`run`.
KEPT: dict[int, Task] = {}


def kept_task(key: int, *, truth: bool) -> Task:
    """Return a task of :func:`run`."""
    return KEPT[key] if truth else replace(KEPT[key], truth=None)


def ends_task(mesh: Mesh, *, angle: float = 30.0, name: str = "ends") -> DeformationTask:
    """Fix the lowest tenth along z, turn the highest tenth about z by `angle` degrees and lift it."""
    turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    handles = end_handles(mesh.V, turn=turn, shift=[0, 0, 0.1])
    return DeformationTask(name, mesh, handles, meta={"angle": angle})


def bumpy_task(*, level: int = 3, angle: float = 30.0) -> DeformationTask:
    """Load the task of ``dataset=bumpy``."""
    return ends_task(bumpy(level), angle=angle, name=f"bumpy_{angle:g}")


def failing(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that raises."""
    raise ArithmeticError("this method\nalways fails")


def writing(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that doubles the shape in the arrays that it was given."""
    task.mesh.V.flags.writeable = True
    task.mesh.V[:] *= 2
    return DeformationResult(vertices=task.mesh.V, iterations=0, converged=None)


def missing_extra(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method whose extra is not installed."""
    raise ImportError("torch is not installed; install the extra torch")


def stretching(task, *, factor: float = 2.0, seed: int, progress=silent) -> DeformationResult:
    """A method that scales; it never converges."""
    return DeformationResult(
        vertices=task.mesh.V * factor,
        iterations=7,
        converged=False,
        seconds={"solve": 0.5},
        extra={"residual": np.float64(np.inf), "rotations": np.zeros((2, 3, 3))},
    )


def endless(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method that returns only on the mesh of the warm-up."""
    while task.mesh.n != 642:
        sleep(0.01)
    return DeformationResult(vertices=task.mesh.V, iterations=0, converged=None)


def sleeping(task, *, seconds: float, seed: int, progress=silent) -> DeformationResult:
    """A method that sleeps for some seconds and changes nothing."""
    sleep(seconds)
    return DeformationResult(vertices=task.mesh.V, iterations=0, converged=None)


def killed(task, *, seed: int, progress=silent) -> DeformationResult:
    """A method whose process dies as if the system killed it for lack of memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def with_options(
    task, *, vertices: int | None = None, volume: float = 0.0, seed: int, progress=silent
) -> DeformationResult:
    """A method that reports its resolved options."""
    options = {"vertices": vertices or 1000, "volume": np.inf, "frames": "blended", "seed": seed}
    return DeformationResult(task.mesh.V, iterations=0, converged=None, extra={"options": options})
