"""Make the moving picture of the README: ``python -m docs.drag``.

A paw and then the nose of a cat are dragged and let go. Each frame is one step of a ``sshade.Deformer``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from defaust.sources.animals import Animals
from defaust.tasks.loop import loop_matrix, split
from sshade import Deformer, Handles, Mesh
from sshade.core.console import say
from sshade.plotting.pictures import View, new_plotter, panel

PICTURE = Path(__file__).parent / "figures" / "drag.gif"
#: Frames a second, seconds of the picture, its width in pixels, and number of its colours.
RATE, SECONDS, WIDTH, COLOURS = 12.5, 10.0, 560, 48
#: Landmarks with handles, and the radius of a group in metres. The last two groups are dragged.
GROUPS, RADIUS = ("forefoot_r", "hindfoot_l", "hindfoot_r", "forefoot_l", "nose"), 0.022
PAW, NOSE = 3, 4
#: Places of each dragged group: time in seconds, shift in metres, and angles in degrees about x, y and z.
PATHS = {
    PAW: [
        (0.6, (0, 0, 0), (0, 0, 0)),
        (1.8, (0, 0.12, 0.1), (-90, 0, 0)),
        (2.5, (0.05, 0.18, 0.11), (-110, 0, 0)),
        (3.1, (-0.02, 0.15, 0.12), (-100, 0, 0)),
        (3.7, (0.05, 0.18, 0.11), (-110, 0, 0)),
    ],
    NOSE: [
        (5.2, (0, 0, 0), (0, 0, 0)),
        (6.3, (0.12, 0.02, -0.02), (0, 55, 0)),
        (7.9, (0.05, 0.08, 0.0), (-20, 20, 0)),
    ],
}
#: Rate of decay and frequency, in 1/s, of a group that was let go.
DECAY, SWING = 6.0, 0.8
#: Outline of the pointer in pixels, with its tip at the origin.
POINTER = np.array([(0, 0), (0, 17), (4, 13), (7, 19), (10, 18), (7, 12), (12, 12)])


def cat() -> tuple[Mesh, list[np.ndarray]]:
    """Return a cat of 110,000 vertices and the vertices of its groups of handles."""
    source = Animals()
    low = source.rest(0)
    fine = split(split(low))
    mesh = Mesh(loop_matrix(low, fine, steps=2) @ low.V, fine.F)
    places = [low.V[source.landmark_vertices(0)[name]] for name in GROUPS]
    return mesh, [np.flatnonzero(np.linalg.norm(mesh.V - at, axis=1) < RADIUS) for at in places]


def place(path: list, time: float) -> np.ndarray:
    """Return the shift and the angles (6,) of a group at a time."""
    times, values = np.array([step[0] for step in path]), np.array([(*step[1], *step[2]) for step in path])
    after = time - times[-1]
    if after > 0:
        return values[-1] * np.exp(-DECAY * after) * np.cos(2 * np.pi * SWING * after)
    return CubicHermiteSpline(times, values, np.zeros_like(values))(max(time, times[0]))


def frames() -> list[Image.Image]:
    """Drag, and draw every step."""
    mesh, groups = cat()
    index, group = np.concatenate(groups), np.repeat(range(len(groups)), [len(one) for one in groups])
    drag, shown = Deformer(mesh, index, group=group), Handles(index, mesh.V[index], dynamic=group >= PAW)
    view = View.of([mesh.V, mesh.V + [0.02, 0.05, 0.02]], towards=(1.0, 0.3, 0.8))
    size = view.pixels(WIDTH)
    pictures = []
    for time in np.arange(0, SECONDS, 1 / RATE):
        target = mesh.V[index]
        for number, path in PATHS.items():
            own, motion = group == number, place(path, time)
            centre, turn = target[own].mean(axis=0), Rotation.from_euler("xyz", motion[3:], degrees=True)
            target[own] = turn.apply(target[own] - centre) + centre + motion[:3]
        V = drag.step(target, tolerance=1e-4).vertices
        plotter = new_plotter(window_size=size)
        panel(plotter, mesh, V, view, handles=shown)
        picture = Image.fromarray(plotter.screenshot(return_img=True))
        plotter.close()
        for number, path in PATHS.items():
            if path[0][0] < time < path[-1][0]:
                draw_pointer(picture, view, target[group == number].mean(axis=0))
        pictures.append(picture)
    return pictures


def draw_pointer(picture: Image.Image, view: View, at: np.ndarray) -> None:
    """Draw a pointer of a mouse at a point of the scene."""
    right, up, _ = view.axes @ (at - view.centre) * picture.width / view.size[0]
    outline = POINTER + [picture.width / 2 + right, picture.height / 2 - up]
    ImageDraw.Draw(picture).polygon([(x, y) for x, y in outline], "black", "white")


def main() -> None:
    """Write the picture, whose frames share their colours."""
    pictures = frames()
    some = np.concatenate([np.asarray(picture) for picture in pictures[::20]])
    some[:10] = 0  # the outline of the pointer
    palette = Image.fromarray(some).quantize(COLOURS, kmeans=1)
    first, *others = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    colours = np.reshape(palette.getpalette(), (-1, 3))
    colours[first.getpixel((0, 0))] = 255  # so that the background is white
    for picture in (first, *others):
        picture.putpalette(colours.ravel().tolist())
    first.save(PICTURE, save_all=True, append_images=others, duration=round(1000 / RATE), loop=0)
    say(f"{PICTURE}: {PICTURE.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
