"""``sshade deform --with``: carry clothes, hair, point clouds and splats with the mesh."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sshade.cli.arguments import read
from sshade.cli.console import say
from sshade.errors import InputError
from sshade.io.document import SUFFIXES, MeshFile, check_input
from sshade.io.files import check_output, expecting, naming

if TYPE_CHECKING:
    from sshade.carry.points import BoundPoints
    from sshade.io.splats import PointFile
    from sshade.mesh.mesh import Mesh


class Carried(NamedTuple):
    """A file that goes with the mesh, the name of its output, and its bound vertices."""

    source: Path
    file: MeshFile | PointFile
    output: Path
    bound: BoundPoints


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --with."""
    text = "meshes, point clouds or Gaussian splats (.ply), such as clothes or hair, that lie on, inside "
    text += "or near MESH and go with it; with -o posed.ply, shirt.obj becomes posed_shirt.obj"
    parser.add_argument("--with", dest="carried", nargs="+", type=Path, default=[], metavar="FILE", help=text)


def outputs(options: argparse.Namespace, output: Path) -> list[Path]:
    """Return the names of the outputs of --with beside `output`, after a check that they can be written.

    Raises
    ------
    InputError
        When a file is missing or of another format, or an output is an input or another output.
    """
    names: list[Path] = []
    inputs = [*(getattr(options, name) for name in options.inputs), *options.carried]
    for source in options.carried:
        check_input(source, SUFFIXES)
        path = output.with_name(f"{output.stem}_{source.name}")
        check_output(path, SUFFIXES, inputs=inputs, overwrite=None)
        if path in names or path == output:
            raise InputError(f"{path}: would be the output of two files; rename one of them")
        names.append(path)
    return names


def bind_files(sources: Sequence[Path], names: Sequence[Path], mesh: Mesh) -> list[Carried]:
    """Read files and bind their vertices to a mesh at rest.

    Raises
    ------
    InputError
        When a file cannot be read, or a vertex is too far from the mesh. The message names the file.
    """
    from sshade.carry.points import PointBinder

    if not sources:
        return []
    binder, found = PointBinder(mesh), []
    for source, path in zip(sources, names, strict=True):
        file = _read(source)
        with naming(source):
            found.append(Carried(source, file, path, binder.bind(file.V)))
    return found


def _read(source: Path) -> MeshFile | PointFile:
    from sshade.io.splats import read_points

    if source.suffix.lower() == ".ply" and source.stat().st_size > 0:
        with expecting("a readable PLY file", source):
            points = read_points(source)
        if points is not None:
            return points
    file = read(source)
    if source.suffix.lower() not in file.suffixes:
        raise InputError(f"{source}: its coordinates are integers; save them as floating-point numbers")
    return file


def write_files(carried: Sequence[Carried], V: np.ndarray) -> None:
    """Write the files in a pose V (n, 3) of the mesh, with all their contents."""
    from sshade.io.meshes import write_file

    for source, file, path, bound in carried:
        what = "points"
        if isinstance(file, MeshFile):
            write_file(path, file, bound(V))
        else:
            file.write(path, *bound.with_maps(V))
            what = "splats" if file.is_splats else "points"
        say(f"{path}: {len(file.V)} {what} of {source} carried with the mesh")
