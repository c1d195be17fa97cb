"""Arguments, files and saved options that several sub-commands of ``sshade`` share."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.core.whole_files import check_output, naming
from sshade.files.by_library import READABLE, WRITABLE, require_libraries
from sshade.files.handle_files import FORMATS as HANDLE_FILES
from sshade.files.handle_files import is_landmark_file
from sshade.files.mesh_file import MeshFile, listed
from sshade.mesh.weld import check_weld
from sshade.problem.options import accepted, described, help_text, require_method, resolve

if TYPE_CHECKING:
    from sshade.files.handle_files import HandleFile
    from sshade.files.open_shape import OpenShape
    from sshade.problem.handles import Handles
    from sshade.problem.task import DeformationTask

#: Place of the number in the name of numbered files.
NUMBER = re.compile(r"%(0\d+)?d")
#: Formats of meshes to write, for `--help`.
FORMATS = ", ".join(WRITABLE)
#: Descriptions of arguments that several commands take.
REST, HANDLES = f"rest shape ({', '.join(READABLE)})", "handle file (.json, .yaml)"


def add_files(
    parser: argparse.ArgumentParser, *, output: str, several: Collection[str] = (), **positional: str
) -> None:
    """Declare paths by name with their descriptions, and -o with the name `output`.

    The paths in `several` are lists of one path or more.
    """
    for name, text in positional.items():
        number = "+" if name in several else None
        parser.add_argument(name, type=Path, nargs=number, metavar=name.upper(), help=text)
    text = f"mesh to write, in the format of its name ({FORMATS})"
    parser.add_argument("-o", "--output", type=Path, required=True, metavar=output, help=text)
    add_overwrite(parser, positional)


def add_overwrite(parser: argparse.ArgumentParser, inputs: Iterable[str]) -> None:
    """Declare --overwrite, and the names of the inputs for :func:`check_outputs`."""
    text = "allow an output to replace an input; other existing files are always replaced"
    add_flags(parser, {"--overwrite": text})
    parser.set_defaults(inputs=tuple(inputs))


def check_outputs(options: argparse.Namespace, **suffixes: Collection[str]) -> None:
    """Raise InputError unless the named outputs have known suffixes, can be written, and are no inputs.

    Outputs that are None are skipped. With --overwrite an output may be an input.
    """
    inputs = input_paths(options)
    for name, known in suffixes.items():
        if (path := getattr(options, name)) is not None:
            check_output(path, known, inputs=inputs, overwrite=options.overwrite)
            require_libraries(path)


def require_mesh_first(mesh: Path, handles: Iterable[Path]) -> None:
    """Raise InputError if MESH is a handle file, or one of the handle files is a mesh."""
    late = [path for path in handles if path.suffix.lower() in READABLE]
    if mesh.suffix.lower() not in READABLE:
        if late:
            raise InputError(f"{mesh}: the mesh comes before the handles; did you mean `{late[0]} {mesh}`?")
        if mesh.suffix.lower() in HANDLE_FILES or is_landmark_file(mesh):
            raise InputError(f"{mesh}: is a file of handles; give the mesh first")
    elif late:
        raise InputError(
            f"{late[0]}: is a mesh; handles are in a file {', '.join(HANDLE_FILES)}, or in two landmark files"
        )


def input_paths(options: argparse.Namespace) -> list[Path | None]:
    """Return the paths of all inputs; None stands for an input that is left out."""
    given = (getattr(options, name) for name in options.inputs)
    return [path for one in given for path in (one if isinstance(one, list) else [one])]


def has_number(path: Path) -> bool:
    """Whether a name has a place for a number."""
    return NUMBER.search(path.name) is not None


def add_flags(parser: argparse.ArgumentParser, flags: Mapping[str, str]) -> None:
    """Declare flags with their descriptions."""
    for flag, text in flags.items():
        parser.add_argument(flag, action="store_true", help=text)


def add_repair(parser: argparse.ArgumentParser) -> None:
    """Declare --weld and --repair, which change how the surface is made from the mesh."""
    text = "largest distance of a copy of a vertex from its place, as a fraction of the diagonal; "
    text += "copies along a seam move as one (default: 1e-9, or two rounding steps of a file in single "
    text += "precision; 0 for exact copies alone)"
    parser.add_argument("--weld", type=_number, metavar="W", help=text)
    text = "weld all copies of a vertex, along seams or not, and drop faces that are there twice; the output "
    text += "still has all vertices of the input"
    add_flags(parser, {"--repair": text})


def add_options(
    parser: argparse.ArgumentParser, names: Iterable[str], defaults: Mapping[str, Any] | None = None
) -> None:
    """Declare an argument for each option. `defaults` are values that replace the defaults of the methods."""
    names, defaults = tuple(names), defaults or {}
    for name in names:
        flag, option, default = f"--{name.replace('_', '-')}", described()[name], defaults.get(name)
        text = help_text(name, default)
        text = text if "coarser" in names else text.replace(" (see `coarser`)", "")
        if option.kind == "bool":
            parser.add_argument(flag, default=default, action=argparse.BooleanOptionalAction, help=text)
        elif option.choices:
            parser.add_argument(flag, default=default, choices=option.choices, help=text)
        else:
            parser.add_argument(flag, default=default, type=_number, metavar=name[0].upper(), help=text)


def _number(text: str) -> float:
    """Convert an argument to a number; whole numbers that a float can hold become int, for later checks."""
    try:
        return int(text) if text.lstrip("-").isdigit() and len(text) < 300 else float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error


def read(path: Path, output: Path | None = None) -> MeshFile:
    """Read a mesh file, and report its oddities and contents that the format of `output` cannot hold."""
    from sshade.files.meshes import read_file

    file = read_file(path)
    for note in file.notes:
        say(f"note: {path}: {note}")
    if output is not None and (lost := file.lost(output)):
        kept = f"; a {' or '.join(file.suffixes)} file keeps all" if file.suffixes else ""
        say(f"note: {output} loses the {listed(lost)} of {path}: only positions and faces are written{kept}")
    return file


def open_mesh(options: argparse.Namespace, output: Path | None = None) -> tuple[MeshFile, OpenShape]:
    """Read MESH as :func:`read`, and open it with --weld and --repair."""
    from sshade.files.open_shape import open_shape  # imports large libraries

    file = read(options.mesh, output)
    with naming(options.mesh):
        return file, open_shape(file, weld=options.weld, repair=options.repair)


class OpenTask(NamedTuple):
    """The files of ``sshade deform`` that were read.

    Attributes
    ----------
    file, shape : MeshFile and OpenShape
        MESH.
    given : sequence of HandleFile
        HANDLES: one file, or a file for each pose of a sequence.
    poses : list of Handles
        The handles of each file on the surface of the shape.
    task : DeformationTask
        With the handles of the first pose.
    """

    file: MeshFile
    shape: OpenShape
    given: Sequence[HandleFile]
    poses: list[Handles]
    task: DeformationTask


def open_task(options: argparse.Namespace, given: Sequence[HandleFile]) -> OpenTask:
    """Open MESH as :func:`open_mesh`, and place the handles of files on it, which --weight makes soft.

    Raises
    ------
    InputError
        When handles do not fit the mesh, or differ between poses. The message names the file.
    """
    from sshade.files.open_shape import on_shape  # imports large libraries

    file, shape = open_mesh(options, options.output)
    poses: list[Handles] = []
    # Landmarks of the target, behind those at rest, belong to the same pose.
    for path, one in zip(options.handles[: len(given)], given, strict=True):
        if shape.space and (others := {*one.spaces} - {"", shape.space}):
            spaces = f"in {others.pop()}, and {options.mesh} is in {shape.space}"
            say(f"note: {path} has landmarks {spaces}: x and y of the landmarks change their signs")
        with naming(path):
            poses.append(on_shape(one, shape))
            poses[-1].require_same(poses[0])
    if options.weight is not None:
        soft = options.weight
        poses = [replace(pose, weight=np.where(pose.hard, soft, pose.weight)) for pose in poses]
    task = shape.task(options.mesh.stem, poses[0], refuse_unconstrained=options.refuse_unconstrained)
    return OpenTask(file, shape, given, poses, task)


def take_saved_options(options: argparse.Namespace, path: Path, given: HandleFile) -> None:
    """Take the options of a handle file that the command line leaves out, and report them.

    Raises
    ------
    InputError
        On an unknown option, or a value out of its range.
    """
    made = given.made
    of_method = {name: value for name, value in made.items() if name not in ("method", "weld", "repair")}
    with naming(f'{path}, key "made"'):
        resolve(require_method(made.get("method", "fast")), of_method)
        if "weld" in made:
            check_weld(made["weld"])
    foreign = {*of_method} - {*accepted(options.method or made.get("method", "fast"))}
    taken = {
        name: value
        for name, value in made.items()
        if name not in foreign
        and (getattr(options, name, None) is None or (name == "repair" and not options.repair))
    }
    for name, value in taken.items():
        setattr(options, name, value)
    if taken:
        listed = ", ".join(f"{name} {value}" for name, value in taken.items())
        say(f"note: {path} sets {listed}; switches change this")
