"""Make the pictures of artefacts in docs/limits.md, and the picture of the option `detail` in docs/beyond.md.

``python -m docs.artefacts [NAME ...]`` makes the named ones, by default all.

The bodies are subject 0 of ``data/defaust_20k``, which ``make tables`` builds.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from baselines.accelerated import accelerated_elastic
from defaust.sources.generated.lattices import bar
from defaust.sources.generated.motions import Twist
from defaust.tasks import load_task
from eval.metrics import Deformed
from eval.publish.plotting import picture
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.core.console import say
from sshade.plotting.pictures import View

FIGURES = Path(__file__).with_name("figures")
BODIES = Path(__file__).parents[1] / "data" / "defaust_20k"
Vector = tuple[float, float, float]


class Example(NamedTuple):
    """Tasks with methods and their options, and a view of the rest shape and of the results.

    The vertices `shown` (n,) fill the picture; faces with `hidden` vertices (n,) are left out. Colours show
    the largest bend at a vertex, up to `top` degrees; at 0, they show the faces that intersect others.
    """

    runs: list[tuple[DeformationTask, str]]
    towards: Vector
    top: float
    shown: np.ndarray
    hidden: np.ndarray


def body(pose: int, name: str, *places: Vector, handles: str = "stored") -> DeformationTask:
    """Load a body. The 30 vertices nearest to each place become a handle group that goes to the true pose."""
    task = load_task(BODIES, subject=0, pose=pose, handles=handles)
    for place in places:
        near, old = np.argsort(np.linalg.norm(task.mesh.V - place, axis=1), kind="stable")[:30], task.handles
        index, target = np.append(old.index, near), np.concatenate([old.target, task.truth[near]])
        group = np.append(old.group, np.full(30, old.group.max() + 1))
        task = replace(task, handles=Handles(index, target, group=group))
    return replace(task, name=name)


def waist() -> Example:
    """A sitting body, of which the picture shows one half."""
    few, places = body(9, "7 groups"), [(0, 0.95, -0.15), (0, 1.3, 0.2), (0.13, 0.5, 0.1), (-0.13, 0.5, 0.1)]
    more, (x, y, _) = body(9, "11 groups", *places), few.mesh.V.T
    runs = [(few, "Elastic; fast; fine"), (more, "fast; fast thickness=1; truth")]
    return Example(runs, (1, 0.05, 0.15), 30, (y > 0.4) & (abs(x + 0.12) < 0.12), x > 0)


def detail() -> Example:
    """A sitting body for several values of the option `detail`, of which the picture shows one half."""
    sitting = body(9, "sitting")
    fine = [f"fine detail={value:g}" for value in np.linspace(1, 0, 5)]
    methods = "; ".join(["Elastic", *fine, "fast", "truth"])
    x, y, _ = sitting.mesh.V.T
    return Example([(sitting, methods)], (1, 0.05, 0.15), 30, (y > 0.1) & (abs(x + 0.12) < 0.12), x > 0)


def face() -> Example:
    """A head with one fixed vertex at the nose."""
    one, many = body(1, "1 vertex", handles="points"), body(1, "30 vertices")
    runs = [(one, "Elastic; fast; fine; fine bending=0.003"), (many, "fine; fine attachment=0.1")]
    x, y, _ = one.mesh.V.T
    return Example(runs, (0.6, 0.1, 1), 25, (y > 1.45) & (abs(x) < 0.15), y < 0)


def twisted(name: str, *, degrees: float = 135) -> DeformationTask:
    """Return a bar of side 1 along the y axis with its ends as handle regions; the upper end turns."""
    length = 4.0
    V, F = bar(10000, length=length)
    index = np.flatnonzero(abs(V[:, 2] - length / 2) >= length / 2 - 0.5)
    V, truth = (W[:, [1, 2, 0]] for W in (V, Twist(0.5, length - 0.5, degrees)(V)))
    moved = V[index, 1] > length / 2
    handles = Handles(index, truth[index], dynamic=moved, group=moved.astype(int))
    return DeformationTask(name, Mesh(V, F), handles, truth=truth)


def twist() -> Example:
    """A twisted bar."""
    task = twisted("135°")
    methods, every = (
        "Elastic; fast; fine; fast thickness=1; fine thickness=1; truth",
        np.ones(task.mesh.n, bool),
    )
    return Example([(task, methods)], (1, 0.5, 1), 90, every, ~every)


def arms() -> Example:
    """Hands that meet in front of the chest."""
    few, more = body(7, "7 groups"), body(7, "9 groups", (0.36, 1.22, -0.02), (-0.36, 1.22, -0.02))
    runs = [(few, "Elastic; fast; fine; fast thickness=1"), (more, "fast"), (few, "truth")]
    x, y, _ = few.mesh.V.T
    return Example(runs, (0.3, 0.4, 1), 0, (y > 0.95) & (abs(x) < 0.3), y < 0)


#: Examples by the names of their pictures.
EXAMPLES = {f.__name__: f for f in (waist, face, twist, arms, detail)}


def solve(task: DeformationTask, method: str) -> Deformed:
    """Return the result of a method, and print the time."""
    begin, (name, *options) = perf_counter(), method.split()
    values = {key: float(value) for key, value in (option.split("=") for option in options)}
    if name == "Elastic":
        V = accelerated_elastic(task, start="rigid").vertices
    else:
        V = task.truth if name == "truth" else deform(task, method=name, **values).vertices
    say(f"{method.strip()}, {task.name}: {perf_counter() - begin:.1f} s")
    return Deformed(task, V)


def colours(result: Deformed, top: float) -> np.ndarray:
    """Return the largest bend at each vertex (n,); for `top` 0, 1 at faces that intersect others."""
    found, corners = np.zeros(result.mesh.n), result.rest.topology.dihedral[:2] if top else result.mesh.F.T
    values = result.dihedral_changes if top else result.intersecting
    np.maximum.at(found, corners, np.broadcast_to(values, corners.shape))
    return found


def draw(example: Example, shapes: list[Deformed]) -> np.ndarray:
    """Return a picture of shapes side by side at one scale."""
    rest, centred, panels = shapes[0].mesh, [], []
    for s in shapes:
        low, high = (f(s.shape.V[example.shown], axis=0) for f in (np.min, np.max))
        centred.append(s.shape.V - (low + high) / 2)
    view = View.of([V[example.shown] for V in centred], towards=example.towards)
    vertex, F = np.unique(rest.F[~example.hidden[rest.F].any(axis=1)], return_inverse=True)
    part, top = Mesh(rest.V[vertex], F.reshape(-1, 3)), example.top or 1.4
    for s, V in zip(shapes, centred, strict=True):
        drawn = np.isin(s.task.handles.index, vertex)
        index, dynamic = s.task.handles.index[drawn], s.task.handles.dynamic[drawn]
        marks = Handles(np.searchsorted(vertex, index), V[index], dynamic=dynamic)
        error = colours(s, example.top)[vertex]
        panels.append(picture(part, V[vertex], view=view, width=200, handles=marks, error=error, top=top))
    return np.hstack(panels)


def make(name: str) -> None:
    """Write the picture of an example."""
    from PIL import Image

    example = EXAMPLES[name]()
    runs = [(task, method) for task, methods in example.runs for method in methods.split(";")]
    results = [solve(*run) for run in runs]
    rest = Deformed(runs[0][0], runs[0][0].mesh.V)
    image = Image.fromarray(draw(example, [rest, *results])).quantize(128)
    image.save(FIGURES / f"artefacts_{name}.png", optimize=True)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or EXAMPLES:
        make(chosen)
