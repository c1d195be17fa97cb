"""``sshade deform --with``: move other meshes, such as clothes and hair, along with the mesh."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sshade.cli.arguments import input_paths, read
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.core.whole_files import check_output, naming
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.files.mesh_file import MeshFile, between

if TYPE_CHECKING:
    from sshade.files.open_shape import OpenShape
    from sshade.mesh.mesh import Mesh


class Companion(NamedTuple):
    """A mesh file that goes along with the mesh, and the name of its output."""

    source: Path
    file: MeshFile
    output: Path
    axes: np.ndarray  # (3,) factors that convert its positions to the coordinate system of the mesh


def outputs(options: argparse.Namespace) -> list[Path]:
    """Return the names of the outputs of --with beside OUT, after a check that they can be written.

    Raises
    ------
    InputError
        When a file is missing or of another format, or an output is an input or another output.
    """
    names: list[Path] = []
    output = options.output
    inputs = [*input_paths(options), *options.along]
    for source in options.along:
        check_mesh(source)
        path = output.with_name(f"{output.stem}_{source.name}")
        check_output(path, WRITABLE, inputs=inputs, overwrite=None)
        if path in names or path == output:
            raise InputError(f"{path}: would be the output of two files; rename one of them")
        names.append(path)
    return names


def read_files(sources: Sequence[Path], names: Sequence[Path], shape: OpenShape) -> list[Companion]:
    """Read the files that go along with a mesh at rest.

    Raises
    ------
    InputError
        When a file cannot be read or holds no triangles, or a vertex is too far from the mesh. The message
        names the file.
    """
    from sshade.proxy.along import require_near

    found = []
    for source, path in zip(sources, names, strict=True):
        file = read(source)
        with naming(source):
            file.require_triangles()
        if source.suffix.lower() not in file.suffixes:
            raise InputError(
                f"{source}: cannot be written again with all its contents; save it as a .ply file with "
                "floating-point numbers"
            )
        axes = between(file.space, shape.space)
        with naming(source):
            require_near(shape.mesh, file.V * axes)
        found.append(Companion(source, file, path, axes))
    return found


def write_files(companions: Sequence[Companion], mesh: Mesh, V: np.ndarray) -> None:
    """Write the files in a pose V (n, 3) of the mesh, with all their contents."""
    from sshade.files.meshes import write_file
    from sshade.proxy.along import FAR, how_far, moved_with_distance

    moved = moved_with_distance(mesh, V, np.concatenate([one.file.V * one.axes for one in companions]))
    ends = np.cumsum([len(one.file.V) for one in companions])[:-1]
    parts = zip(companions, *(np.split(values, ends) for values in moved), strict=True)
    for (source, file, path, axes), positions, distance in parts:
        write_file(path, file, positions * axes)
        say(f"{path}: {len(positions)} vertices of {source} moved along with the mesh")
        if distance.max() > FAR:
            say(f"note: {source}: its vertices are up to {how_far(distance.max())}")
