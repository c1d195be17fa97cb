"""Draw the film strips of docs/sequences.md: ``python -m docs.sequences``.

A body is deformed for the poses of a motion, and the poses of a horse drive a cat through marks.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from defaust.tasks.motions import body_motion, drives
from sshade import Handles, Mesh, deform_sequence, retarget
from sshade.figures import View, new_plotter, panel

FIGURE = Path(__file__).parent / "figures" / "sequences.png"
#: Size of a panel in pixels, panels in a row, and number of colours of the picture.
SIZE, COLUMNS, COLOURS = (230, 210), 5, 128


class Strip(NamedTuple):
    """A row of the picture: shapes of a mesh, the direction to the camera, and handles."""

    shapes: list[np.ndarray]
    rest: Mesh
    towards: tuple[float, float, float]
    handles: Handles | None = None


def strips() -> list[Strip]:
    """Compute the rows of the picture."""
    motion = body_motion(pose="bend_twist", count=9, level=1)
    body = [result.vertices for result in deform_sequence(motion.task, motion.targets)][::2]
    (drive,) = drives((("horse", "cat"),))
    driven = retarget(drive.source, drive.poses, drive.target, marks=drive.marks)
    front, side = (0.6, 0.25, 1.0), (1.0, 0.45, 0.75)
    return [
        Strip(body, motion.task.mesh, front, motion.task.handles),
        Strip([drive.source.V, *drive.poses], drive.source, side),
        Strip([drive.target.V, *(one.vertices for one in driven)], drive.target, side),
    ]


def main() -> None:
    """Compute the strips and write the picture."""
    from PIL import Image

    rows = strips()
    size = COLUMNS * SIZE[0], len(rows) * SIZE[1]
    plotter = new_plotter(shape=(len(rows), COLUMNS), window_size=size)
    for row, strip in enumerate(rows):
        centred = [V - 0.5 * (V.min(axis=0) + V.max(axis=0)) for V in strip.shapes]
        view = View.of(centred, towards=strip.towards)
        for column, V in enumerate(centred):
            plotter.subplot(row, column)
            panel(plotter, strip.rest, V, view, handles=strip.handles)
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    Image.fromarray(pixels).quantize(COLOURS).save(FIGURE, optimize=True)


if __name__ == "__main__":
    main()
