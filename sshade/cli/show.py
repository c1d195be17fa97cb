"""Show a mesh in a window, or write a picture with -o.

HANDLES are drawn in blue (fixed) and yellow (movable), with pale targets of movable handles. --deformed adds
a second shape beside the mesh, coloured by the change of edge length at each vertex.

example:
  sshade show body.ply pose.json --deformed posed.ply -o posed.png

Pictures need the extra figures, for example by pip install '.[figures]' in a clone.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.cli.arguments import (
    add_mesh_and_handles,
    add_repair,
    check_outputs,
    corresponding,
    read,
    read_surface,
)
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.atomic import naming, replacing
from sshade.files.document import SUFFIXES, check_input
from sshade.files.entries import read_handle_file
from sshade.plotting.pictures import TOWARDS, UP, View, colour_range, edge_error, new_plotter, panel

if TYPE_CHECKING:
    from sshade.mesh.mesh import Mesh
    from sshade.problem.task import Handles

#: Suffixes of pictures.
PICTURES = (".png", ".jpg", ".jpeg")


#: Width of a panel, and its greatest height, in pixels.
PANEL = 900
#: Least width of a picture with a colour bar, in pixels.
LEAST = 450


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_mesh_and_handles(parser, output="PICTURE", text=f"picture to write ({', '.join(PICTURES)})")
    parser.add_argument("--deformed", type=Path, metavar="OUT", help="deformed shape, with the same vertices")
    parser.set_defaults(inputs=("mesh", "handles", "deformed"))
    for name, default, text in (
        ("towards", TOWARDS, "direction to the camera"),
        ("up", UP, "upward direction"),
    ):
        about: dict[str, Any] = {"default": default, "metavar": ("X", "Y", "Z")}
        about["help"] = f"{text} (default: {' '.join(f'{x:g}' for x in default)})"
        parser.add_argument(f"--{name}", type=float, nargs=3, **about)
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Show the shapes, or write the picture; return the exit code."""
    path = options.output
    if path is None and not has_display():
        raise InputError("there is no display for a window; write a picture with -o, such as -o picture.png")
    check_outputs(options, output=PICTURES)
    check_input(options.mesh, SUFFIXES)
    if options.deformed is not None:
        check_input(options.deformed, SUFFIXES)
    given = None if options.handles is None else read_handle_file(options.handles)
    from sshade.files.handles import on_surface

    file, whole = read_surface(options)
    mesh = whole.mesh
    with naming(options.handles):
        handles = None if given is None else on_surface(given, whole)
    deformed = None
    if options.deformed is not None:
        shape = read(options.deformed)
        deformed = corresponding(shape, options.deformed, file, options.mesh, whole)
        deformed = mesh.checked(deformed, f"file {options.deformed}")
    window = path is None
    plotter = draw(mesh, handles, deformed=deformed, window=window, towards=options.towards, up=options.up)
    if path is None:
        plotter.show(title=f"sshade show {options.mesh}")
        return 0
    from PIL import Image  # after pyvista, which brings it

    pixels = plotter.screenshot(return_img=True)
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary)  # pyvista knows no upper-case suffix
    plotter.close()
    say(str(path))
    return 0


def has_display() -> bool:
    """Whether a window can be opened. On Linux the environment says so, elsewhere it is assumed."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def draw(
    mesh: Mesh, handles: Handles | None, *, deformed: np.ndarray | None, window: bool, **look: np.ndarray
) -> Any:
    """Return a pyvista plotter with the rest shape and the deformed shape side by side, with linked views.

    The directions `towards` and `up` are those of :meth:`sshade.plotting.pictures.View.of`.
    """
    shapes = [mesh.V] if deformed is None else [mesh.V, deformed]
    view = View.of(shapes if handles is None else [*shapes, handles.target], **look)
    if deformed is not None:
        view = view.with_foot(0.12)  # for the colour bar
    width, height = view.pixels(PANEL)
    scale = min(1.0, PANEL / height)
    least = 0 if deformed is None else LEAST  # for the words of the colour bar
    size = (len(shapes) * max(round(scale * width), least), round(scale * height))
    plotter = new_plotter(off_screen=not window, shape=(1, len(shapes)), window_size=size)
    for column, V in enumerate(shapes):
        plotter.subplot(0, column)
        error = edge_error(mesh, V) if column else None
        top = 1.0 if error is None else colour_range([error])
        bar = "edge length change (%)" if column else None
        panel(plotter, mesh, V, view, error=error, top=top, bar=bar, handles=handles, targets=not column)
    plotter.link_views()
    return plotter
