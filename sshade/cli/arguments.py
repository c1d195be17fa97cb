"""Arguments and files that several sub-commands of ``sshade`` share."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.atomic import check_output, naming
from sshade.files.handwritten import read_option_file, require_known
from sshade.files.mesh_file import SUFFIXES, MeshFile, listed
from sshade.mesh.weld import NEAR, check_weld
from sshade.problem.options import described, help_text, require_method

if TYPE_CHECKING:
    from sshade.files.door import OpenShape

#: Least share of edges that shapes with the same order of vertices have in common, of the shape with fewer;
#: and about how many vertices it is tried on.
ALIKE, TRIED = 0.5, 10_000
#: Formats of meshes, for `--help`.
FORMATS = ", ".join(SUFFIXES)


#: Descriptions of arguments that several commands take.
REST, HANDLES = f"rest shape ({FORMATS})", "handle file (.json, .yaml)"
CARRY = "move components without handles rigidly with the nearest component that has handles, such as eyes "
CARRY += "with a head"


def add_files(
    parser: argparse.ArgumentParser, *, output: str, several: Collection[str] = (), **positional: str
) -> None:
    """Declare paths by name with their descriptions, and -o with the name `output`.

    The paths in `several` are lists of one path or more.
    """
    for name, text in positional.items():
        number: dict[str, Any] = {"nargs": "+"} if name in several else {}
        parser.add_argument(name, type=Path, metavar=name.upper(), help=text, **number)
    text = f"mesh to write, in the format of its name ({FORMATS})"
    parser.add_argument("-o", "--output", type=Path, required=True, metavar=output, help=text)
    _add_overwrite(parser, positional)


def add_mesh_and_handles(parser: argparse.ArgumentParser, *, output: str, text: str) -> None:
    """Declare MESH, and HANDLES and -o, which may be left out."""
    parser.add_argument("mesh", type=Path, metavar="MESH", help=REST)
    parser.add_argument("handles", type=Path, nargs="?", metavar="HANDLES", help=HANDLES)
    parser.add_argument("-o", "--output", type=Path, metavar=output, help=text)
    _add_overwrite(parser, ("mesh", "handles"))


def _add_overwrite(parser: argparse.ArgumentParser, inputs: Iterable[str]) -> None:
    """Declare --overwrite, and the names of the inputs for :func:`check_outputs`."""
    text = "allow an output to replace an input; other existing files are always replaced"
    add_flags(parser, {"--overwrite": text})
    parser.set_defaults(inputs=tuple(inputs))


def check_outputs(options: argparse.Namespace, **suffixes: Collection[str]) -> None:
    """Raise InputError unless the named outputs have one of the suffixes, can be written, and are no inputs.

    Outputs that are None are skipped. With --overwrite an output may be an input.
    """
    inputs = [getattr(options, name) for name in options.inputs]
    for name, known in suffixes.items():
        if (path := getattr(options, name)) is not None:
            check_output(path, known, inputs=inputs, overwrite=options.overwrite)


def add_flags(parser: argparse.ArgumentParser, flags: Mapping[str, str]) -> None:
    """Declare flags with their descriptions."""
    for flag, text in flags.items():
        parser.add_argument(flag, action="store_true", help=text)


def add_repair(parser: argparse.ArgumentParser) -> None:
    """Declare --weld and --repair, which change how the surface is made from the mesh."""
    text = "largest distance of a copy of a vertex from its place, as a fraction of the diagonal; "
    text += "copies along a seam move as one (default: 1e-9, or two rounding steps of a file in single "
    text += "precision; 0 for exact copies alone)"
    parser.add_argument("--weld", type=_weld, default=NEAR, metavar="W", help=text)
    text = "weld all copies of a vertex, along seams or not, and drop faces that are there twice; the output "
    text += "still has all vertices of the input"
    add_flags(parser, {"--repair": text})


def _weld(text: str) -> float:
    weld = _argument(text)
    try:
        check_weld(weld)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return weld


def add_options(
    parser: argparse.ArgumentParser, names: Iterable[str], *, further: Iterable[str] = (), **defaults: Any
) -> None:
    """Declare --options and an argument for each option.

    Parameters
    ----------
    parser : ArgumentParser
    names : iterable of str
    further : iterable of str
        Other arguments that a file of options may have beside --weld and --repair.
    **defaults
        Values that replace the defaults of the methods.
    """
    names = tuple(names)
    add_option_file(parser, (*names, *further, "weld", "repair"))
    for name in names:
        option, default = described()[name], defaults.get(name)
        text = help_text(name, default)
        text = text if "coarser" in names else text.replace(" (see `coarser`)", "")
        about: dict[str, Any] = {"default": default, "help": text}
        if option.kind == "bool":
            about["action"] = argparse.BooleanOptionalAction
        elif option.choices:
            about["choices"] = option.choices
        else:
            about |= {"type": _argument, "metavar": name[0].upper()}
        parser.add_argument(f"--{name.replace('_', '-')}", **about)


def add_option_file(parser: argparse.ArgumentParser, names: Iterable[str]) -> None:
    """Declare --options, a file that may have values for some arguments; see :func:`with_option_file`."""
    text = "file of option names and values (.yaml, .json), or a handle file that the editor saved; switches "
    text += "on the command line take precedence"
    parser.add_argument("--options", type=Path, metavar="FILE", help=text)
    parser.set_defaults(names_in_file=tuple(names), from_file={}, with_file=with_option_file)


def with_option_file(
    parser: argparse.ArgumentParser, options: argparse.Namespace, arguments: Sequence[str]
) -> argparse.Namespace:
    """Return the parsed `arguments`, with the values of --options where no switch gives a value.

    Raises
    ------
    InputError
        When the file cannot be read, a name is unknown to the command, or a value is out of its range.
    """
    path = options.options
    if path is None:
        return options
    given = read_option_file(path, options.names_in_file)
    with naming(path):
        require_known(given, options.names_in_file)
        known = {name: given[name] for name in options.names_in_file if given.get(name) is not None}
        values = {name: _checked(name, value) for name, value in known.items()}
    parser.set_defaults(**values, from_file=values)
    return parser.parse_args(arguments)


def _checked(name: str, value: Any) -> Any:
    """Return a valid value of a file of options, and raise InputError on any other."""
    option = described().get(name)
    if name == "method" or (option is not None and option.choices):
        if not isinstance(value, str):
            raise InputError(f"{name} must be a name, not {value!r}")
        return option.checked(name, value) if option else require_method(value)
    # YAML takes 1e-5 and inf for words.
    if isinstance(value, str | int) and not isinstance(value, bool):
        with suppress(ValueError):
            value = _number(str(value))
    if option is not None:
        return option.checked(name, value)
    if name not in ("weight", "weld"):
        valid, values = isinstance(value, bool), "true or false"
    else:
        valid, values = isinstance(value, int | float) and not isinstance(value, bool), "a number"
        if valid and name == "weld":
            check_weld(value)
        elif name == "weight":
            valid, values = valid and value > 0, "a number above 0"
    if not valid:
        raise InputError(f"{name} must be {values}, not {value!r}")
    return value


def _number(text: str) -> float:
    """Convert a text to a number, and keep whole numbers that a float can hold as int for later checks."""
    return int(text) if text.lstrip("-").isdigit() and len(text) < 300 else float(text)


def _argument(text: str) -> float:
    """Convert an argument to a number; see :func:`_number`."""
    try:
        return _number(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error


def read(path: Path, output: Path | None = None) -> MeshFile:
    """Read a mesh file, and report its oddities and contents that the format of `output` cannot hold."""
    from sshade.files.meshes import read_file

    file = read_file(path)
    for note in file.notes:
        say(f"note: {path}: {note}")
    if output is not None and (lost := file.lost(output)):
        say(f"note: {output} loses the {listed(lost)} of {path}, because it has another format")
    return file


def open_mesh(options: argparse.Namespace, output: Path | None = None) -> tuple[MeshFile, OpenShape]:
    """Read MESH as :func:`read`, and open it with --weld and --repair."""
    from sshade.files.door import open_shape  # imports large libraries

    file = read(options.mesh, output)
    with naming(options.mesh):
        return file, open_shape(file, weld=options.weld, repair=options.repair)


def require_same_order(shape: MeshFile, path: Path, F: np.ndarray, other: str) -> None:
    """Raise InputError if a shape has few edges of the faces F (m, 3) of another, as after a new order.

    Shapes with other triangles between the same vertices pass, and shapes that lack faces.
    """
    if np.array_equal(shape.F, F) or not (len(shape.F) and len(F)):
        return
    mine, theirs = (_some_edges(faces, len(shape.V)) for faces in (shape.F, F))
    if len(np.intersect1d(mine, theirs)) < ALIKE * min(len(mine), len(theirs)):
        raise InputError(
            f"{path} has other edges than {other}: its vertices seem to be in another order; export it "
            "without merging or sorting vertices"
        )


def _some_edges(F: np.ndarray, n: int) -> np.ndarray:
    """Return numbers of the edges of faces F (m, 3) whose first of n vertices is one of :data:`TRIED`."""
    tried = np.zeros(n, dtype=bool)
    tried[:: max(1, n // TRIED)] = True
    found = []
    for k in range(3):
        one, other = F[:, k], F[:, k - 1]
        first = np.minimum(one, other)
        here = tried[first]
        found.append(first[here].astype(np.int64) * n + np.maximum(one[here], other[here]))
    return np.unique(np.concatenate(found))


def corresponding(other: MeshFile, path: Path, shape: OpenShape, mesh: Path) -> np.ndarray:
    """Return the positions (k, 3) of the surface's vertices in another shape of a mesh.

    Parameters
    ----------
    other, path : MeshFile and path
        The other shape.
    shape, mesh : OpenShape and path
        The mesh.

    Raises
    ------
    InputError
        When the numbers of vertices differ, or a position is not finite.
    """
    if len(other.V) != len(shape.V):
        raise InputError(
            f"{path} has {len(other.V)} vertices and {mesh} has {len(shape.V)}; they must correspond"
        )
    require_same_order(other, path, shape.F, str(mesh))
    V = shape.surface.picked(other.V)
    require_finite(V, path, shape.surface.original)
    return V


def require_finite(V: np.ndarray, path: Path, number: np.ndarray | None = None) -> None:
    """Raise InputError if a position V (k, 3) of a file is not finite; `number` (k,) are the ids there."""
    if not (finite := np.isfinite(V).all(axis=1)).all():
        bad = int(np.argmin(finite))
        vertex = bad if number is None else number[bad]
        raise InputError(f"{path}: vertex {vertex} has a NaN or infinite coordinate; write the file again")
