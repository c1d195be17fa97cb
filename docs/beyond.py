"""The pictures of docs/beyond.md: ``python -m docs.beyond [NAME ...]`` makes them, by default all.

They are of bodies that ``defaust build source=synthetic out=data/defaust`` makes.
Each shows a body with one addition of this project left out, and with it. The page's numbers come from
committed tables, by :mod:`docs.pages`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.ablations import sshade_fast_without
from defaust.tasks import load_task
from sshade import DeformationTask, Handles, sshade, sshade_fast
from sshade.figures import View, edge_error, picture

ROOT = Path(__file__).parents[1]
FIGURES, DATA = ROOT / "docs" / "figures", ROOT / "data" / "defaust"


#: Of a picture, which keep it small: its colours, and the width of each shape in pixels.
COLOURS, WIDTH = 256, 260


class Example(NamedTuple):
    """A task, shapes (n, 3) of its mesh from left to right, and a view.

    `shown` are the vertices that fill the picture, by default all. Where `top` is set, colours show how much
    the edges at a vertex change, up to this percentage.
    """

    task: DeformationTask
    shapes: list[np.ndarray]
    shown: np.ndarray | None = None
    towards: tuple[float, float, float] = (0.5, 0.25, 1.0)
    top: float | None = None
    handles: bool = False


def body(subject: int, pose: int) -> DeformationTask:
    """A body at full size, the handles of a pose, and its truth."""
    return load_task(root=str(DATA), subject=subject, pose=pose, resolution="high")


def without(task: DeformationTask, left_out: str) -> np.ndarray:
    """The vertices of `sshade_fast` with one thing left out."""
    return sshade_fast_without(task, without=left_out).vertices


def frames() -> Example:
    """Triangle frames once, averaged over five samplings, and blended frames once."""
    task = body(0, 1)
    V = task.mesh.V
    kinds = (("triangle", 1), ("triangle", 5), ("blended", 1))
    shapes = [sshade(task, samplings=k, frames=kind).vertices for kind, k in kinds]
    return Example(task, shapes, shown=(V[:, 0] > 0.12) & (V[:, 1] > 1.25), top=15.0)


def volume() -> Example:
    """Volume and area free, held, and the truth."""
    task = body(7, 7)
    shapes = [without(task, "held_volume"), without(task, "nothing"), truth(task)]
    return Example(task, shapes, shown=task.mesh.V[:, 1] > 0.9)


def softening() -> Example:
    """The paper's energy, and triangles that soften."""
    task = body(3, 2)
    return Example(task, [without(task, "softening"), without(task, "nothing")], top=10.0)


def parts() -> Example:
    """A head held at its nose: without parts, with them, and the truth."""
    task = body(7, 3)
    shapes = [without(task, "parts_and_lead"), without(task, "nothing"), truth(task)]
    return Example(task, shapes, shown=task.mesh.V[:, 1] > 1.15, handles=True, towards=(1, 0.1, 0.8))


def lead() -> Example:
    """A sitting body: without a leading energy, with it, and the truth."""
    task = body(5, 9)
    return Example(
        task, [without(task, "lead"), without(task, "nothing"), truth(task)], towards=(1, 0.2, 0.6)
    )


def regions() -> Example:
    """The lower third held, the top of the head moved and turned: the paper's method, and `sshade_fast`."""
    mesh = body(0, 1).mesh
    height = (mesh.V[:, 1] - mesh.V[:, 1].min()) / np.ptp(mesh.V[:, 1])
    moved = height > 0.9
    held = np.flatnonzero((height < 0.3) | moved)
    turn = np.radians(40)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    centre = mesh.V[moved].mean(axis=0)
    target = np.where(
        moved[held, None], (mesh.V[held] - centre) @ R.T + centre + [0.1, 0.05, 0.1], mesh.V[held]
    )
    task = DeformationTask("regions", mesh, Handles(held, target, group=moved[held].astype(int)))
    return Example(task, [mesh.V, sshade(task).vertices, sshade_fast(task).vertices], top=10.0)


def truth(task: DeformationTask) -> np.ndarray:
    """The true pose of a body."""
    assert task.truth is not None
    return task.truth


#: By the name of their picture.
EXAMPLES: dict[str, Callable[[], Example]] = {
    f.__name__: f for f in (frames, volume, softening, parts, lead, regions)
}


def draw(name: str) -> None:
    """Write an example's picture, its shapes side by side on one scale."""
    from PIL import Image

    example = EXAMPLES[name]()
    task, shown = example.task, example.shown
    part = slice(None) if shown is None else shown
    view = View.of([V[part] for V in example.shapes], towards=example.towards)
    panels = []
    for V in example.shapes:
        error = None if example.top is None else edge_error(task.mesh, V)
        handles = task.handles if example.handles else None
        panels.append(
            picture(
                task.mesh, V, view=view, width=WIDTH, error=error, top=example.top or 1.0, handles=handles
            )
        )
    path = FIGURES / f"beyond_{name}.png"
    Image.fromarray(np.hstack(panels)).quantize(COLOURS).save(path, optimize=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or EXAMPLES:
        draw(name)
