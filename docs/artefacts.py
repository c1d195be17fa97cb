"""Make the pictures and tables of docs/artefacts.md and one of docs/beyond_fine.md.

``python -m docs.artefacts [NAME ...]`` makes the named ones, by default all.

The bodies are subject 0 of ``data/defaust_20k``, which ``make tables`` builds. Times are printed only.
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
from docs.blocks import fill, markdown
from eval.metrics import Deformed, measure
from eval.publish.columns import COLUMNS
from eval.publish.plotting import picture
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.core.console import say
from sshade.plotting.pictures import View

PAGE, BODIES = Path(__file__).with_suffix(".md"), Path(__file__).parents[1] / "data" / "defaust_20k"
MEASURES = "bend_tail", "spike", "distortion_99", "edge", "volume", "self_intersections", "truth_distance"
COLUMN = {column.source.removeprefix("metric."): column for column in COLUMNS}
Vector = tuple[float, float, float]


class Example(NamedTuple):
    """Tasks with methods and their options, and a view of the rest shape and of the methods with a star.

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
    first = "*Elastic; *fast; *fine; fast strain_limit=0.25; fast thickness=1; fine detail=0.75"
    then = "Elastic; *fast; fine; fast bending=0.006; fast strain_limit=0.25; *fast thickness=1"
    runs = [(few, first), (more, f"{then}; fine thickness=1; *truth")]
    shown = (y > 0.4) & (abs(x + 0.12) < 0.12)
    return Example(runs, (1, 0.05, 0.15), 30, shown, x > 0)


def detail() -> Example:
    """A sitting body for several values of the option `detail`, of which the picture shows one half."""
    sitting = body(9, "sitting")
    fine = [f"*fine detail={value:g}" for value in np.linspace(1, 0, 5)]
    methods = "; ".join(["*Elastic", *fine, "*fast", "*truth"])
    x, y, _ = sitting.mesh.V.T
    return Example([(sitting, methods)], (1, 0.05, 0.15), 30, (y > 0.1) & (abs(x + 0.12) < 0.12), x > 0)


def face() -> Example:
    """A head with one fixed vertex at the nose."""
    one, many = body(1, "1 vertex", handles="points"), body(1, "30 vertices")
    alone = "*Elastic; *fast; *fine; fast bending=0.003; *fine bending=0.003; fine strain_limit=0.1"
    together = "Elastic; fast; *fine; fine bending=0.003; *fine attachment=0.1"
    regions, (x, y, _) = body(1, "regions", handles="regions"), one.mesh.V.T
    runs = [(one, alone), (many, together), (regions, "fast; fine")]
    return Example(runs, (0.6, 0.1, 1), 25, (y > 1.45) & (abs(x) < 0.15), y < 0)


def twisted(name: str, *, length: float = 4, degrees: float = 135) -> DeformationTask:
    """Return a bar of side 1 along the y axis with its ends as handle regions; the upper end turns."""
    V, F = bar(10000, length=length)
    index = np.flatnonzero(abs(V[:, 2] - length / 2) >= length / 2 - 0.5)
    V, truth = (W[:, [1, 2, 0]] for W in (V, Twist(0.5, length - 0.5, degrees)(V)))
    moved = V[index, 1] > length / 2
    handles = Handles(index, truth[index], dynamic=moved, group=moved.astype(int))
    return DeformationTask(name, Mesh(V, F), handles, truth=truth)


def twist() -> Example:
    """A twisted bar."""
    long, short, far = twisted("135°"), twisted("135°, half as long", length=2), twisted("200°", degrees=200)
    first = "*Elastic; *fast; *fine; fast volume=0; fast bending=0.01; fine strain_limit=0.1"
    runs = [(long, f"{first}; *fast thickness=1; *fine thickness=1; *truth")]
    runs += [(short, "fast thickness=1; fine thickness=1"), (far, "fine thickness=1")]
    every = np.ones(long.mesh.n, dtype=bool)
    return Example(runs, (1, 0.5, 1), 90, every, ~every)


def arms() -> Example:
    """Hands that meet in front of the chest."""
    few, more = body(7, "7 groups"), body(7, "9 groups", (0.36, 1.22, -0.02), (-0.36, 1.22, -0.02))
    first = "*Elastic; *fast; *fine; fast attachment=0; fast strain_limit=0.25; *fast thickness=1"
    runs = [(few, f"{first}; fine thickness=1"), (more, "*fast; fine"), (few, "*truth")]
    x, y, _ = few.mesh.V.T
    return Example(runs, (0.3, 0.4, 1), 0, (y > 0.95) & (abs(x) < 0.3), y < 0)


#: Examples by the names of their pictures and blocks.
EXAMPLES = {f.__name__: f for f in (waist, face, twist, arms, detail)}
#: Pages of examples that are not in docs/artefacts.md.
PAGES = {"detail": PAGE.with_name("beyond_fine.md")}


def solve(task: DeformationTask, method: str) -> tuple[Deformed, list[str]]:
    """Return the result of a method and its row of the table, and print the time."""
    begin, (name, *options) = perf_counter(), method.strip(" *").split()
    values = {key: float(value) for key, value in (option.split("=") for option in options)}
    if name == "Elastic":
        V = accelerated_elastic(task, start="rigid").vertices
    else:
        V = task.truth if name == "truth" else deform(task, method=name, **values).vertices
    title, seconds, found = f"{method.strip(' *')}, {task.name}", perf_counter() - begin, measure(task, V)
    say(f"{title}: {seconds:.1f} s")
    return Deformed(task, V), [title, *(COLUMN[name].text(found[name]) for name in MEASURES)]


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
    """Write the table and the picture of an example."""
    from PIL import Image

    example = EXAMPLES[name]()
    runs = [(task, method) for task, methods in example.runs for method in methods.split(";")]
    results, rows = zip(*(solve(*run) for run in runs), strict=True)
    head = ["run", *(COLUMN[measure].label for measure in MEASURES)]
    fill(PAGES.get(name, PAGE), {name: markdown(head, rows)})
    drawn = [result for result, (_, method) in zip(results, runs, strict=True) if "*" in method]
    rest = Deformed(runs[0][0], runs[0][0].mesh.V)
    image = Image.fromarray(draw(example, [rest, *drawn])).quantize(128)
    image.save(PAGE.parent / "figures" / f"artefacts_{name}.png", optimize=True)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or EXAMPLES:
        make(chosen)
