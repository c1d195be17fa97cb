"""The pictures and the numbers of docs/measures.md: ``python docs/measures.py`` makes both again.

Each example is a few shapes of one mesh, of which one is good in one measure and bad in another.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.accelerated import accelerated_elastic
from eval.metrics import METRICS, measure
from sshade import DeformationTask, Handles, Mesh
from sshade.figures import View, edge_error, picture

FOLDER = Path(__file__).parent
PAGE = FOLDER / "measures.md"


class Example(NamedTuple):
    """A task, shapes of its mesh by what they are called, the measures that tell them apart, and a view.

    Where `top` is set, colours show how much the edges at a vertex change, up to this percentage.
    """

    task: DeformationTask
    shapes: dict[str, np.ndarray]
    measures: tuple[str, ...]
    towards: tuple[float, float, float] = (0.15, -1.0, 0.25)
    top: float | None = None


def revolved(radius: np.ndarray, height: np.ndarray, *, around: int = 24) -> Mesh:
    """A closed surface about the z axis, through circles of these radii (k,) at these heights (k,)."""
    turn = 2 * np.pi * np.arange(around) / around
    rings = np.stack([np.outer(radius, np.cos(turn)), np.outer(radius, np.sin(turn))], axis=2)
    V = np.concatenate([rings, np.broadcast_to(height[:, None, None], (*rings.shape[:2], 1))], axis=2)
    poles = [[0, 0, height[0]], [0, 0, height[-1]]]
    ring = np.arange(around)
    following = (ring + 1) % around
    quads = [
        side
        for start in around * np.arange(len(radius) - 1)
        for side in (
            np.stack([ring, following, following + around], axis=1) + start,
            np.stack([ring, following + around, ring + around], axis=1) + start,
        )
    ]
    bottom, last = around * len(radius), around * (len(radius) - 1)
    caps = [
        np.stack([following, ring, np.full(around, bottom)], axis=1),
        np.stack([ring + last, following + last, np.full(around, bottom + 1)], axis=1),
    ]
    return Mesh(np.concatenate([V.reshape(-1, 3), poles]), np.concatenate(quads + caps))


def tube(length: float) -> Mesh:
    """A closed tube of radius 0.6."""
    return revolved(np.full(64, 0.6), np.linspace(0, length, 64))


def ball() -> Mesh:
    """A sphere of radius 1."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 34)[1:-1]
    return revolved(np.cos(latitude), np.sin(latitude), around=48)


def crease() -> Example:
    """A tube bent by 120 degrees: over an arc, and by what changes lengths least."""
    mesh, angle, begin, end = tube(10.0), np.radians(120), 2.5, 7.5
    x, y, z = mesh.V.T
    share, radius = np.clip((z - begin) / (end - begin), 0, 1), (end - begin) / angle
    beyond = z - np.clip(z, begin, end)
    sine, cosine = np.sin(angle * share), np.cos(angle * share)
    arc = np.stack(
        [radius - (radius - x) * cosine + beyond * sine, y, begin + (radius - x) * sine + beyond * cosine],
        axis=1,
    )
    held = np.flatnonzero(np.abs(z - 5) > 3.8)
    task = DeformationTask("bend", mesh, Handles(held, arc[held], group=(z[held] > 5).astype(int)), truth=arc)
    shapes = {"over an arc": arc, "least stretch (Elastic)": accelerated_elastic(task).vertices}
    names = ("edge", "angle", "distortion_99", "volume", "bend", "bend_tail", "detail", "truth_normal")
    return Example(task, shapes, names)


def size() -> Example:
    """A sphere a little larger, one squeezed at the same volume, one reshaped at the same area."""
    mesh = ball()
    pear = mesh.V * (1 + mesh.V[:, 2:] * [0.4, 0.4, 0])
    shapes = {
        "1 % larger": 1.01 * mesh.V,
        "squeezed": mesh.V * [1.5, 1 / 1.5, 1],
        "a pear": pear * np.sqrt(mesh.area / Mesh(pear, mesh.F).area),
    }
    return Example(free(mesh), shapes, ("volume", "area", "edge", "angle", "distortion_99"))


def tails() -> Example:
    """A tube that is longer everywhere, and one of which a single ring of faces has collapsed."""
    mesh = tube(2.0)
    ring = np.unique(mesh.V[:, 2])[31:33]
    pinched = mesh.V.copy()
    pinched[mesh.V[:, 2] == ring[1], 2] -= 0.95 * (ring[1] - ring[0])
    shapes = {"4 % longer": mesh.V * [1, 1, 1.04], "one ring collapsed": pinched}
    return Example(
        free(mesh),
        shapes,
        ("edge", "angle", "distortion_95", "distortion_99", "distortion_max", "collapsed"),
        top=50.0,
    )


def spike() -> Example:
    """A vertex of a sphere pulled out alone, and with the hill around it."""
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
    """A task that asks for nothing: a vertex held where it is."""
    return DeformationTask("free", mesh, Handles(np.array([0]), mesh.V[:1]))


#: By the name of their picture and of their table in the page.
EXAMPLES: dict[str, Callable[[], Example]] = {f.__name__: f for f in (crease, size, tails, spike)}


def table(name: str) -> str:
    """The Markdown table of an example: a line a shape, a column a measure."""
    example = EXAMPLES[name]()
    lines = [
        ("shape", *(f"{m} ({METRICS[m].unit})" if METRICS[m].unit != "-" else m for m in example.measures))
    ]
    lines.append(("---", *("---:" for _ in example.measures)))
    for title, V in example.shapes.items():
        found = measure(example.task, V, only=example.measures)
        lines.append((title, *(format(round(found[m], 3), ".4g") for m in example.measures)))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def draw(name: str) -> None:
    """Write an example's picture: the rest shape, then the others, on one scale."""
    import matplotlib.image

    example = EXAMPLES[name]()
    mesh = example.task.mesh
    shapes = [mesh.V, *example.shapes.values()]
    centred = [V - 0.5 * (V.min(axis=0) + V.max(axis=0)) for V in shapes]
    view = View.of(centred, towards=example.towards, up=(0, 0, 1))
    panels = [
        picture(mesh, V, view=view, width=240)
        if example.top is None
        else picture(mesh, V, view=view, width=240, error=edge_error(mesh, V), top=example.top)
        for V in centred
    ]
    matplotlib.image.imsave(FOLDER / "figures" / f"measures_{name}.png", np.hstack(panels))


def filled(page: str) -> str:
    """The page with its tables made again; each stands between ``<!-- name -->`` and ``<!-- end -->``."""
    for name in EXAMPLES:
        head, mark, rest = page.partition(f"<!-- {name} -->\n")
        _, end, rest = rest.partition("\n<!-- end -->")
        if not (mark and end):  # all that follows would be lost
            raise ValueError(f"the page has no block {name}")
        page = head + mark + table(name) + end + rest
    return page


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text()))
    for example in EXAMPLES:
        draw(example)
