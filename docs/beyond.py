"""Draw the pictures of docs/beyond.md: ``python -m docs.beyond [NAME ...]``; the default is all.

The pictures need the bodies that ``defaust build source=synthetic out=data/defaust`` builds. Each picture
shows a body without one change of `fast`, and with it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.ablations import fast_without
from defaust.tasks import load_task
from eval.publish.plotting import picture
from sshade import DeformationTask, Handles, deform
from sshade.plotting.pictures import View, edge_error

ROOT = Path(__file__).parents[1]
FIGURES, DATA = ROOT / "docs" / "figures", ROOT / "data" / "defaust"


#: Number of colours of a picture, and width of each shape in pixels. Both keep the files small.
COLOURS, WIDTH = 256, 260


class Example(NamedTuple):
    """A task, shapes (n, 3) of its mesh from left to right, and a view.

    The vertices `shown` fill the picture; None means all. If `top` is set, colours show how much the edges
    at a vertex change, up to this percentage.
    """

    task: DeformationTask
    shapes: list[np.ndarray]
    shown: np.ndarray | None = None
    towards: tuple[float, float, float] = (0.5, 0.25, 1.0)
    top: float | None = None
    handles: bool = False


def body(subject: int, pose: int) -> DeformationTask:
    """Load a body at full size with the handles and the ground truth of a pose."""
    return load_task(root=str(DATA), subject=subject, pose=pose, resolution="high")


def without(task: DeformationTask, left_out: str) -> np.ndarray:
    """Return the result of `fast` without one change."""
    return fast_without(task, without=left_out).vertices


def frames() -> Example:
    """Triangle frames, the mean of five samplings, and blended frames."""
    task = body(0, 1)
    V = task.mesh.V
    kinds = (("triangle", 1), ("triangle", 5), ("blended", 1))
    shapes = [deform(task, method="paper", samplings=k, frames=kind).vertices for kind, k in kinds]
    return Example(task, shapes, shown=(V[:, 0] > 0.12) & (V[:, 1] > 1.25), top=15.0)


def volume() -> Example:
    """Volume and area unconstrained, constrained, and the true pose."""
    task = body(7, 7)
    shapes = [without(task, "constraints"), without(task, "nothing"), truth(task)]
    return Example(task, shapes, shown=task.mesh.V[:, 1] > 0.9)


def softening() -> Example:
    """The energy of the paper, and softening triangles."""
    task = body(3, 2)
    return Example(task, [without(task, "softening"), without(task, "nothing")], top=10.0)


def attachment() -> Example:
    """A head fixed at its nose: without attachment, with attachment, and the true pose."""
    task = body(7, 3)
    shapes = [without(task, "attachment_and_guide"), without(task, "nothing"), truth(task)]
    return Example(task, shapes, shown=task.mesh.V[:, 1] > 1.15, handles=True, towards=(1, 0.1, 0.8))


def guide() -> Example:
    """A sitting body: without the guide energy, with the guide energy, and the true pose."""
    task = body(5, 9)
    shapes = [without(task, "guide"), without(task, "nothing"), truth(task)]
    return Example(task, shapes, towards=(1, 0.2, 0.6))


def regions() -> Example:
    """The lower third fixed, the top of the head moved and turned: rest shape, `paper` and `fast`."""
    mesh = body(0, 1).mesh
    height = (mesh.V[:, 1] - mesh.V[:, 1].min()) / np.ptp(mesh.V[:, 1])
    moved = height > 0.9
    handles = np.flatnonzero((height < 0.3) | moved)
    turn = np.radians(40)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    centre = mesh.V[moved].mean(axis=0)
    target = mesh.V[handles]
    turned = (target - centre) @ R.T + centre + [0.1, 0.05, 0.1]
    target = np.where(moved[handles, None], turned, target)
    task = DeformationTask("regions", mesh, Handles(handles, target, group=moved[handles].astype(int)))
    return Example(task, [mesh.V, deform(task, method="paper").vertices, deform(task).vertices], top=10.0)


def truth(task: DeformationTask) -> np.ndarray:
    """Return the true pose of a body."""
    assert task.truth is not None
    return task.truth


#: Examples by the names of their pictures.
EXAMPLES = {f.__name__: f for f in (frames, volume, softening, attachment, guide, regions)}


def draw(name: str) -> None:
    """Write the picture of an example: its shapes side by side at one scale."""
    from PIL import Image

    example = EXAMPLES[name]()
    task, shown = example.task, example.shown
    part = slice(None) if shown is None else shown
    view = View.of([V[part] for V in example.shapes], towards=example.towards)
    panels = []
    for V in example.shapes:
        error = None if example.top is None else edge_error(task.mesh, V)
        handles = task.handles if example.handles else None
        colours = {"error": error, "top": example.top or 1.0, "handles": handles}
        panels.append(picture(task.mesh, V, view=view, width=WIDTH, **colours))
    path = FIGURES / f"beyond_{name}.png"
    Image.fromarray(np.hstack(panels)).quantize(COLOURS).save(path, optimize=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or EXAMPLES:
        draw(name)
