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
from typing import Any

from sshade.cli.arguments import (
    add_mesh_and_handles,
    add_repair,
    check_outputs,
    open_mesh,
    read,
)
from sshade.cli.correspondence import corresponding
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.atomic import naming, replacing
from sshade.files.handle_files import read_handle_file
from sshade.files.mesh_file import SUFFIXES, check_input
from sshade.plotting.pictures import TOWARDS, UP, draw

#: Suffixes of pictures.
PICTURES = (".png", ".jpg", ".jpeg")


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
    from sshade.files.door import on_shape

    _, shape = open_mesh(options)
    mesh = shape.mesh
    with naming(options.handles):
        handles = None if given is None else on_shape(given, shape)
    deformed = None
    if options.deformed is not None:
        deformed = corresponding(read(options.deformed), options.deformed, shape, options.mesh)
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
