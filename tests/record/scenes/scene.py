"""What scenes share: their registry, a body, a limb, and tasks."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sshade import DeformationTask, Mesh, deform
from tests.shapes import bumpy, moved_parts, tube, upwards

#: What a scene yields: names and values.
Values = Iterator[tuple[str, Any]]
BODY = bumpy(4)
LIMB = tube(30, 80, length=7.0)
SCENES: dict[str, Callable[[], Values]] = {}
#: Scenes whose calls and memory are not recorded.
ONCE: set[str] = set()


def scene(function: Callable[[], Values]) -> Callable[[], Values]:
    SCENES[function.__name__] = function
    return function


def outcomes(function: Callable[[], Values]) -> Callable[[], Values]:
    """A scene of many small calls, of which only what they give is recorded."""
    ONCE.add(function.__name__)
    return scene(function)


def patches(mesh: Mesh = BODY, count: int = 12, turn: float = 0.5, **more: Any) -> DeformationTask:
    """The ends of a mesh along z: one stays, the other turns and moves."""
    order = upwards(mesh.V)
    R = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    centre = mesh.V[order[-count:]].mean(axis=0)
    moved = lambda V: centre + (V - centre) @ R.T + [0.2, 0.1, 0.1]  # noqa: E731
    own = moved_parts(mesh.V, (order[:count], 0), (order[-count:], moved), **more)
    return DeformationTask("t", mesh, replace(own, dynamic=own.group > 0))


def solved(task: DeformationTask, **options: Any) -> Values:
    ended: dict[str, bool] = {}

    def report(stage: str, done: int, total: int, note: str = "") -> None:
        ended[stage] = done == total

    yield "result", deform(task, progress=report, **options)
    yield "progress", ended
