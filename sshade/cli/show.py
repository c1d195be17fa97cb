"""Show shapes in the browser, or write a page or a picture with -o.

FILES are the mesh, shapes with the same vertices, such as a result, and a handle file. Two landmark files, of
the rest shape and the target, may replace the handle file. Buttons on the page and the key b switch between
the shapes, w shows the edges, and two shapes may be beside each other. Textures and colours are those of the
mesh. Handles are dots, in blue (fixed) and yellow (moved), with pale targets.

examples:
  sshade show body.ply
  sshade show body.ply pose.json posed.ply
  sshade show body.ply posed.ply --colour stretch -o posed.html

Pages need nothing else. Pictures (-o posed.png) need the extra figures, for example by
pip install '.[figures]' in a clone.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sshade.cli.arguments import FORMATS, HANDLES, add_repair, check_outputs, open_mesh, read
from sshade.cli.correspondence import corresponding
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.core.natural import in_natural_order
from sshade.core.whole_files import naming, replacing
from sshade.files.by_library import READABLE, check_mesh
from sshade.files.handle_files import FORMATS as HANDLE_FILES
from sshade.files.handle_files import is_landmark_file, pose_files, read_handle_file
from sshade.plotting.pictures import CAMERAS, COLOUR_LABELS, draw

if TYPE_CHECKING:
    import numpy as np

    from sshade.files.mesh_file import MeshFile
    from sshade.files.open_shape import OpenShape
    from sshade.files.skin import DrawnSkin

#: Suffixes of pages and of pictures.
PAGES, PICTURES = (".html",), (".png", ".jpg", ".jpeg")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = f"meshes ({FORMATS}) with the same vertices, and a {HANDLES}"
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help=text)
    text = f"page or picture to write ({', '.join(PAGES + PICTURES)}); by default a page opens in the browser"
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help=text)
    text = "colour the shapes after the first by the change of edge length, or by the distance from the first"
    parser.add_argument("--colour", choices=COLOUR_LABELS, help=text)
    parser.add_argument("--up", choices=CAMERAS, default="y", help="axis that points up (default: y)")
    add_repair(parser)
    parser.set_defaults(inputs=(), overwrite=False)  # a page or a picture is no input


def command(options: argparse.Namespace) -> int:
    """Show the shapes, or write the page or picture; return the exit code."""
    check_outputs(options, output=PAGES + PICTURES)
    meshes, pose = _sorted(options.files)
    for path in meshes:
        check_mesh(path)
    given = read_handle_file(*pose) if pose else None
    from sshade.files.open_shape import on_shape

    options.mesh = meshes[0]
    file, shape = open_mesh(options)
    with naming(pose[0] if pose else None):
        handles = None if given is None else on_shape(given, shape)
    poses = {}
    for path in meshes[1:]:
        V = corresponding(read(path), path, shape, options.mesh)
        name = path.stem if path.stem not in poses else str(path)
        poses[name] = shape.mesh.checked(V, f"file {path}")
    camera = CAMERAS[options.up]
    path = options.output
    if path is not None and path.suffix.lower() in PICTURES:
        towards, up = camera
        plotter = draw(
            shape.mesh, handles, list(poses.values()), colour=options.colour, towards=towards, up=up
        )
        _write_picture(path, plotter)
    else:
        from sshade.plotting.figure import figure_of
        from sshade.plotting.view import LARGE

        colours, skin = _dress(file, shape)
        figure = figure_of(
            shape.mesh,
            handles,
            poses,
            colour=options.colour,
            camera=camera,
            size=LARGE,
            colours=colours,
            skin=skin,
        )
        if path is None:
            number, name = tempfile.mkstemp(prefix=f"sshade_{options.mesh.stem}_", suffix=".html")
            os.close(number)
            path = Path(name)
        figure.save(path)
        if options.output is None and not webbrowser.open(path.as_uri()):
            say("no browser was found; open the page yourself")
    say(str(path))
    return 0


def _dress(file: MeshFile, shape: OpenShape) -> tuple[np.ndarray | None, DrawnSkin | None]:
    """Return the colours and the materials of a mesh file, as far as they can be read."""
    from sshade.files.skin import has_skin, skin_on
    from sshade.files.vertex_colours import colours_on

    skin = None
    try:
        if has_skin(file):
            skin = skin_on(file, shape.surface)
            for material in skin.materials:
                if material.texture is not None:
                    material.texture()
    except (InputError, OSError, ValueError, LookupError) as error:
        say(f"note: {file.source}: textures cannot be shown ({error})")
        skin = None
    return colours_on(file.source, shape.surface), skin


def _sorted(files: list[Path]) -> tuple[list[Path], tuple[Path, ...]]:
    """Return the files of meshes, and the handle file or the two landmark files; () if there are none."""
    meshes = [path for path in files if path.suffix.lower() in READABLE]
    others = [path for path in files if path.suffix.lower() not in READABLE]
    if not meshes:
        for path in others:
            if path.suffix.lower() not in HANDLE_FILES and not is_landmark_file(path):
                check_mesh(path)
        raise InputError(f"no file is a mesh ({FORMATS}); pass the mesh that the handles belong to")
    meshes[1:] = in_natural_order(meshes[1:])
    poses = pose_files(others)
    if len(poses) > 1:
        raise InputError(f"{others[0]} and {others[1]} are no meshes; show takes one handle file")
    return meshes, poses[0] if poses else ()


def _write_picture(path: Path, plotter: Any) -> None:
    """Write what a pyvista plotter shows, and close it."""
    from PIL import Image  # after pyvista, which brings it

    pixels = plotter.screenshot(return_img=True)
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary)  # pyvista knows no upper-case suffix
    plotter.close()
