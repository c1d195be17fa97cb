"""Draw the picture of sliding handles in docs/deform.md: ``python -m docs.slides``.

A capsule is fixed at its lower end and pushed or pulled. Each panel shows the capsule before and after, with
a group of handles that slides and the set on which the group slides.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyvista

from docs.measures import revolved
from eval.studies.goals import lathe
from sshade import DeformationTask, Handles, Mesh, Slide, deform
from sshade.figures import BODY, DYNAMIC, STATIC, View, new_plotter, panel

FIGURE = Path(__file__).parent / "figures" / "slides.png"
#: Colours of handles that slide and of their sets.
SLIDING, SET = "#1a9850", "#66bd63"
#: Size of a panel in pixels, panels in a row, and number of colours of the picture.
SIZE, ROW, COLOURS = (370, 310), 3, 128
#: Shift of the shape after from the shape before, and half the extent of drawn planes and lines.
BESIDE, HALF = np.array([2.9, 0.0, 0.0]), 0.85
#: Push of the middle, and pull at the upper end.
PUSH, PULL = np.array([0.9, 0.5, 0.0]), np.array([0.0, 0.0, 0.9])
#: Rotation of the upper end about y.
ANGLE = np.radians(75)
TURN = np.array([[np.cos(ANGLE), 0, np.sin(ANGLE)], [0, 1, 0], [-np.sin(ANGLE), 0, np.cos(ANGLE)]])


class Example(NamedTuple):
    """A title, a slide, the drawn set around the point (3,) of the handles, and how the capsule is moved.

    Attributes
    ----------
    title : str
    slide : Slide
    drawn : callable, optional
    middle : bool
        Whether the middle slides and the upper end is pulled; else the upper end slides.
    turns : bool
        Whether the upper end turns, and nothing is pushed.
    """

    title: str
    slide: Slide
    drawn: Callable[[np.ndarray], Any] | None
    middle: bool = False
    turns: bool = False


def capsule() -> Mesh:
    """Return a capsule of radius 0.5 along z, from -2 to 2."""
    angle = np.linspace(-np.pi / 2, 0, 8)[1:]
    low, high = -1.5 + 0.5 * np.sin(angle), 1.5 - 0.5 * np.sin(angle[::-1])
    height = np.concatenate([low, np.linspace(-1.5, 1.5, 26)[1:-1], high])
    radius = np.concatenate([0.5 * np.cos(angle), np.full(24, 0.5), 0.5 * np.cos(angle[::-1])])
    return revolved(radius, height, around=28)


def dome() -> Mesh:
    """Return the upper part of a sphere of radius 2 that touches the upper end of the capsule."""
    angle = np.linspace(0.01, 0.78, 12)[::-1]
    profile = np.stack([2 * np.sin(angle), 2 * np.cos(angle)], axis=1)
    return lathe(np.append(profile, [[0.0, profile[-1, 1]]], axis=0), around=40)


def flat(normal: tuple[float, float, float]) -> Callable[[np.ndarray], Any]:
    """Return a function that draws a plane around a point."""
    return lambda p: pyvista.Plane(center=p, direction=normal, i_size=2 * HALF, j_size=2 * HALF)


def straight(point: np.ndarray) -> Any:
    """Draw a vertical line through a point."""
    return pyvista.Line(point - [0, 0, 1.1], point + [0, 0, HALF]).tube(radius=0.03)


def surface(mesh: Mesh) -> Callable[[np.ndarray], Any]:
    """Return a function that draws a surface, wherever the point is."""
    return lambda _: pyvista.PolyData.from_regular_faces(mesh.V, mesh.F)


def examples(mesh: Mesh) -> list[Example]:
    """Return the examples in the order of the picture."""
    ground = dome()
    return [
        Example("plane", Slide.plane([0, 0, 1]), flat((0, 0, 1))),
        Example("line", Slide.line([0, 0, 1]), straight),
        Example("axes xz", Slide.axes("xz"), flat((0, 1, 0))),
        Example("surface", Slide.on(ground), surface(ground)),
        Example("rest surface", Slide.on(mesh), surface(mesh), middle=True),
        Example("rotation only", Slide.anywhere(), None, turns=True),
    ]


def task(mesh: Mesh, example: Example) -> DeformationTask:
    """Return the task of an example: group 0 is fixed, group 1 is moved, and group 2 slides."""
    x, _, z = mesh.V.T
    top = z > (1.3 if example.turns else 1.93 if example.slide.surface else 1.75)
    middle = np.abs(z) < 0.2
    moved, sliding = (z > 1.75, middle) if example.middle else (middle & (x < -0.2), top)
    groups = [z < -1.5, np.zeros(mesh.n, dtype=bool) if example.turns else moved, sliding]
    index = np.concatenate([np.flatnonzero(inside) for inside in groups])
    group = np.repeat([0, 1, 2], [int(inside.sum()) for inside in groups])
    shift = np.where((group == 1)[:, None], PULL if example.middle else PUSH, 0.0)
    R = np.where((group == 2)[:, None, None], TURN, np.nan) if example.turns else None
    slide = [example.slide if number == 2 else None for number in group]
    target = mesh.V[index] + shift
    handles = Handles(index, target, dynamic=group > 0, group=group, rotation=R, slide=slide)
    return DeformationTask(example.title, mesh, handles)


def draw(plotter: Any, example: Example, mesh: Mesh, view: View) -> None:
    """Draw the capsule before and after in the active panel, with its handles and their set."""
    scene = task(mesh, example)
    handles, after = scene.handles, deform(scene, vertices=1500).vertices
    ball = pyvista.Sphere(radius=0.05, theta_resolution=10, phi_resolution=10)
    sliding = handles.index[handles.group == 2]
    is_line = example.drawn is straight
    for V, shift in ((mesh.V, 0 * BESIDE), (after, BESIDE)):
        for group, colour in enumerate((STATIC, DYNAMIC, SLIDING)):
            points = pyvista.PolyData(V[handles.index[handles.group == group]] + shift)
            if points.n_points:
                plotter.add_mesh(points.glyph(geom=ball, scale=False, orient=False), color=colour)
        if example.drawn:
            # Lines stay; planes are drawn around the handles.
            drawn = example.drawn((mesh.V if is_line else V)[sliding].mean(axis=0))
            plotter.add_mesh(drawn.translate(shift), color=SET, opacity=1.0 if is_line else 0.3)
    plotter.add_mesh(pyvista.PolyData.from_regular_faces(mesh.V, mesh.F), smooth_shading=True, color=BODY)
    panel(plotter, mesh, after + BESIDE, view)
    plotter.add_text(example.title, position=(0.4 * SIZE[0], 4), font_size=9, color="black")


def main() -> None:
    """Deform the capsules and write the picture."""
    from PIL import Image

    mesh = capsule()
    found = examples(mesh)
    corners = np.array([[-1.2, -0.8, -2.0], [1.7, 0.8, 2.75]])
    both = [corners, corners + BESIDE + [0.5, 0, 0]]
    view = View.of(both, towards=(0.25, -1.0, 0.35), up=(0, 0, 1)).with_foot(0.1)
    rows = -(-len(found) // ROW)
    plotter = new_plotter(shape=(rows, ROW), window_size=(ROW * SIZE[0], rows * SIZE[1]))
    for number, example in enumerate(found):
        plotter.subplot(*divmod(number, ROW))
        draw(plotter, example, mesh, view)
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    Image.fromarray(pixels).quantize(COLOURS).save(FIGURE, optimize=True)


if __name__ == "__main__":
    main()
