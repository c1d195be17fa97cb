"""Show a mesh in a window, or write a picture with -o.

HANDLES are drawn in blue (static) and yellow (dynamic), with pale targets of dynamic handles. --deformed adds
a second shape beside the mesh, coloured by the change of edge length at each vertex.

example:
  sshade show body.ply pose.json --deformed posed.ply -o posed.png

Needs pyvista: pip install 'sshade[figures]'.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from sshade.cli.console import say
from sshade.errors import InputError
from sshade.figures import (
    TOWARDS,
    UP,
    View,
    add_handles,
    add_shape,
    aim,
    colour_range,
    edge_error,
    new_plotter,
    require_extra,
)
from sshade.io.files import check_output, replacing
from sshade.io.meshes import SUFFIXES, read_arrays, read_mesh
from sshade.mesh.mesh import Mesh
from sshade.task import Handles

#: Suffixes of pictures.
PICTURES = (".png", ".jpg", ".jpeg")

#: Width of a panel, and its greatest height, in pixels.
PANEL = 900


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("mesh", type=Path, metavar="MESH", help=f"rest shape ({', '.join(SUFFIXES)})")
    parser.add_argument("handles", type=Path, nargs="?", metavar="HANDLES", help="handle file (.json, .yaml)")
    parser.add_argument("--deformed", type=Path, metavar="OUT", help="deformed shape, with the same vertices")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="PICTURE", help=f"picture to write ({', '.join(PICTURES)})"
    )
    for name, default, text in (
        ("towards", TOWARDS, "direction to the camera"),
        ("up", UP, "upward direction"),
    ):
        shown = " ".join(f"{x:g}" for x in default)
        parser.add_argument(
            f"--{name}",
            type=float,
            nargs=3,
            default=default,
            metavar=("X", "Y", "Z"),
            help=f"{text} (default: {shown})",
        )


def command(options: argparse.Namespace) -> int:
    """Show the shapes, or write the picture; return the exit code."""
    require_extra()
    path = options.output
    if path is None and not has_display():
        raise InputError("there is no display for a window; write a picture with -o, such as -o picture.png")
    if path is not None:
        check_output(path, PICTURES)
    mesh = read_mesh(options.mesh)
    handles = None
    if options.handles is not None:
        from sshade.io.handles import read_handles

        handles = read_handles(options.handles, mesh)
    deformed = None
    if options.deformed is not None:
        deformed = mesh.checked(read_arrays(options.deformed)[0], f"file {options.deformed}")
    plotter = draw(
        mesh, handles, deformed=deformed, towards=options.towards, up=options.up, window=path is None
    )
    if path is None:
        plotter.show(title=f"sshade show {options.mesh}")
        return 0
    with replacing(path) as temporary:
        plotter.screenshot(temporary)
    plotter.close()
    say(str(path))
    return 0


def has_display() -> bool:
    """Whether a window can be opened. On Linux the environment says so, elsewhere it is assumed."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def draw(
    mesh: Mesh,
    handles: Handles | None,
    *,
    deformed: np.ndarray | None,
    towards: np.ndarray,
    up: np.ndarray,
    window: bool,
):
    """Return a pyvista plotter with the rest shape and the deformed shape side by side, with linked views."""
    shapes = [mesh.V] if deformed is None else [mesh.V, deformed]
    around = [*shapes] if handles is None else [*shapes, handles.target]
    view = View.of(around, towards=towards, up=up)
    if deformed is not None:
        view = view.with_foot(0.12)  # for the colour bar
    width, height = view.pixels(PANEL)
    scale = min(1.0, PANEL / height)
    size = (round(len(shapes) * scale * width), round(scale * height))
    plotter = new_plotter(off_screen=not window, shape=(1, len(shapes)), window_size=size)
    for column, V in enumerate(shapes):
        plotter.subplot(0, column)
        error = edge_error(mesh, V) if column else None
        top = 1.0 if error is None else colour_range([error])
        add_shape(plotter, mesh, V, error=error, top=top, bar="edge length change (%)")
        if handles is not None:
            add_handles(plotter, V, handles, size=mesh.diagonal, targets=column == 0)
        aim(plotter, view)
    plotter.link_views()
    return plotter
