"""Make the pictures and tables of docs/measures.md: ``python -m docs.measures``.

Each example has a few shapes of one mesh. One shape is good in one measure and bad in another.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.accelerated import accelerated_elastic
from defaust.sources.generated.motions import Bend
from docs.blocks import fill, markdown
from eval.metrics import METRICS, measure
from eval.publish.plotting import picture
from sshade import DeformationTask, Handles, Mesh
from sshade.plotting.pictures import View, edge_error

FOLDER = Path(__file__).parent
PAGE = FOLDER / "measures.md"


class Example(NamedTuple):
    """A task, shapes of its mesh by title, the measures of the table, and a view.

    If `top` is set, colours show how much the edges at a vertex change, up to this percentage.
    """

    task: DeformationTask
    shapes: dict[str, np.ndarray]
    measures: tuple[str, ...]
    towards: tuple[float, float, float] = (0.15, -1.0, 0.25)
    top: float | None = None


def revolved(radius: np.ndarray, height: np.ndarray, *, around: int = 24) -> Mesh:
    """Return a closed surface of revolution about the z axis, with radii (k,) at heights (k,)."""
    angle = 2 * np.pi * np.arange(around) / around
    x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
    V = np.stack([x, y, np.repeat(height[:, None], around, axis=1)], axis=-1).reshape(-1, 3)
    low, i = np.arange(len(radius) - 1)[:, None] * around, np.arange(around)
    j = (i + 1) % around
    a, b, c, d = low + i, low + j, low + around + j, low + around + i
    sides = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    bottom, top, last = len(V), len(V) + 1, len(V) - around
    caps = [
        np.stack([np.full(around, bottom), j, i], axis=1),
        np.stack([np.full(around, top), last + i, last + j], axis=1),
    ]
    poles = [[0.0, 0.0, height[0]], [0.0, 0.0, height[-1]]]
    return Mesh(np.append(V, poles, axis=0), np.concatenate([*sides, *caps]))


def tube(length: float) -> Mesh:
    """A closed tube of radius 0.6."""
    return revolved(np.full(64, 0.6), np.linspace(0, length, 64))


def ball() -> Mesh:
    """A sphere of radius 1."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 34)[1:-1]
    return revolved(np.cos(latitude), np.sin(latitude), around=48)


def crease() -> Example:
    """A tube bent by 120 degrees: over an arc, and with the smallest change of lengths."""
    mesh = tube(10.0)
    arc, z = Bend(2.5, 7.5, 120.0)(mesh.V), mesh.V[:, 2]
    ends = np.flatnonzero(np.abs(z - 5) > 3.8)
    task = DeformationTask("bend", mesh, Handles(ends, arc[ends], group=(z[ends] > 5).astype(int)), truth=arc)
    shapes = {"over an arc": arc, "least stretch (Elastic)": accelerated_elastic(task).vertices}
    names = ("edge", "angle", "distortion_99", "volume", "bend", "bend_tail", "detail", "truth_normal")
    return Example(task, shapes, names)


def size() -> Example:
    """A sphere enlarged a little, squeezed at equal volume, and reshaped at equal area."""
    mesh = ball()
    pear = mesh.V * (1 + mesh.V[:, 2:] * [0.4, 0.4, 0])
    shapes = {
        "1 % larger": 1.01 * mesh.V,
        "squeezed": mesh.V * [1.5, 1 / 1.5, 1],
        "a pear": pear * np.sqrt(mesh.area / Mesh(pear, mesh.F).area),
    }
    return Example(free(mesh), shapes, ("volume", "area", "edge", "angle", "distortion_99"))


def tails() -> Example:
    """A tube lengthened everywhere, and a tube with one collapsed ring of faces."""
    mesh = tube(2.0)
    ring = np.unique(mesh.V[:, 2])[31:33]
    pinched = mesh.V.copy()
    pinched[mesh.V[:, 2] == ring[1], 2] -= 0.95 * (ring[1] - ring[0])
    shapes = {"4 % longer": mesh.V * [1, 1, 1.04], "one ring collapsed": pinched}
    names = ("edge", "angle", "distortion_95", "distortion_99", "distortion_max", "collapsed")
    return Example(free(mesh), shapes, names, top=50.0)


def spike() -> Example:
    """A vertex of a sphere pulled out with its surroundings, and alone."""
    mesh = ball()
    top = int(np.argmin(np.linalg.norm(mesh.V - [0, -1, 0], axis=1)))
    distance = np.linalg.norm(mesh.V - mesh.V[top], axis=1)
    pull = 0.3 * mesh.V[top]
    shapes = {
        "with its surroundings": mesh.V + np.exp(-((distance / 0.35) ** 2))[:, None] * pull,
        "alone": mesh.V + (distance == 0)[:, None] * pull,
    }
    task = DeformationTask("pull", mesh, Handles(np.array([top]), (mesh.V[top] + pull)[None]))
    return Example(task, shapes, ("edge", "angle", "bend", "spike", "distortion_max"), (1.0, -0.7, 0.3))


def free(mesh: Mesh) -> DeformationTask:
    """Return a task with a single fixed handle."""
    return DeformationTask("free", mesh, Handles(np.array([0]), mesh.V[:1]))


#: Examples by the names of their pictures and blocks.
EXAMPLES = {f.__name__: f for f in (crease, size, tails, spike)}


def table(name: str) -> str:
    """Return the Markdown table of an example: one row per shape, one column per measure."""
    example = EXAMPLES[name]()
    units = {name: METRICS[name].unit for name in example.measures}
    head = [name if unit == "-" else f"{name} ({unit})" for name, unit in units.items()]
    rows = []
    for title, V in example.shapes.items():
        values = measure(example.task, V)
        rows.append([title, *(format(round(values[name], 3), ".4g") for name in example.measures)])
    return markdown(["shape", *head], rows)


def draw(name: str) -> None:
    """Write the picture of an example: the rest shape and all shapes at one scale."""
    import matplotlib.image

    example = EXAMPLES[name]()
    mesh = example.task.mesh
    shapes = [mesh.V, *example.shapes.values()]
    centred = [V - 0.5 * (V.min(axis=0) + V.max(axis=0)) for V in shapes]
    view = View.of(centred, towards=example.towards, up=(0, 0, 1))
    panels = []
    for V in centred:
        colours = {"error": edge_error(mesh, V), "top": example.top} if example.top else {}
        panels.append(picture(mesh, V, view=view, width=240, **colours))
    matplotlib.image.imsave(FOLDER / "figures" / f"measures_{name}.png", np.hstack(panels))


if __name__ == "__main__":
    fill(PAGE, {name: table(name) for name in EXAMPLES})
    for example in EXAMPLES:
        draw(example)
