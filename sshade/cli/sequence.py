"""Sequences of poses in ``sshade deform``: several handle files, and numbered meshes or one glTF file."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.cli.arguments import open_mesh
from sshade.core.console import announced_compilation, progress_bar, say
from sshade.core.errors import InputError
from sshade.files.atomic import check_output, identity, naming
from sshade.files.handle_files import HandleFile, read_handle_file
from sshade.files.mesh_file import MORPHS, SUFFIXES, MeshFile
from sshade.problem.options import Options

if TYPE_CHECKING:
    from sshade.files.door import OpenShape
    from sshade.problem.handles import Handles

#: Poses per second.
FPS = 24.0
#: ``seen(number, V, stored)`` is told the positions (n, 3) of a pose, and the positions that its file holds.
Seen = Callable[[int, np.ndarray, np.ndarray], None]
#: ``solve(number, before)`` returns the positions of a pose in the order of the mesh file. `before` are the
#: stored positions of the pose before, None where the pose is the first.
Solve = Callable[[int, "np.ndarray | None"], np.ndarray]
#: Place of the number in the name of numbered files.
NUMBER = re.compile(r"%(0\d+)?d")


def add_fps(parser: argparse.ArgumentParser) -> None:
    """Declare --fps."""
    text = f"poses per second of several handle files in a .glb or .gltf (default: {FPS:g})"
    parser.add_argument("--fps", type=float, metavar="F", help=text)


def is_sequence(options: argparse.Namespace) -> bool:
    """Whether the arguments of ``sshade deform`` ask for a sequence."""
    return len(options.handles) > 1 or has_number(options.output)


def require_no_fps(options: argparse.Namespace) -> None:
    """Raise InputError if a command that writes one pose was given --fps."""
    if options.fps is not None:
        raise InputError("--fps applies to sequences, and these arguments give one pose")


def has_number(path: Path) -> bool:
    """Whether a name has a place for a number, and raise InputError on two places, or one such as ``%4d``."""
    places = re.findall(r"%\d*d", path.name)
    if places and (len(places) > 1 or not NUMBER.fullmatch(places[0])):
        raise InputError(f"{path}: a pattern has one place for the number, such as out_%04d.ply")
    return bool(places)


def numbered(pattern: Path, number: int) -> Path:
    """Return the path of a pose, counted from 0; files are numbered from 1."""
    return pattern.with_name(NUMBER.sub(lambda place: place.group() % (number + 1), pattern.name))


def check_sequence(options: argparse.Namespace, inputs: list[Path]) -> None:
    """Raise InputError unless the output can hold several poses, can be written, and is no input."""
    options.fps = FPS if options.fps is None else options.fps
    if not options.fps > 0 or not np.isfinite(options.fps):
        raise InputError(f"--fps takes a number above 0, not {options.fps:g}")
    output, known = options.output, SUFFIXES if has_number(options.output) else MORPHS
    if known is MORPHS and output.suffix.lower() in SUFFIXES and output.suffix.lower() not in MORPHS:
        raise InputError(
            f"{output}: one such file cannot hold a sequence; number the files, as in "
            f"{output.stem}_%04d{output.suffix}, or write .glb"
        )
    check_output(output, known, inputs=inputs, overwrite=options.overwrite)


def write_poses(
    output: Path, file: MeshFile, solve: Solve, times: np.ndarray, inputs: list[Path], seen: Seen
) -> str:
    """Solve and write all poses; return the files and the number of poses, for the summary.

    Parameters
    ----------
    output : path
    file : MeshFile
        At rest.
    solve : Solve
    times : (k,) float64
        In seconds.
    inputs : list of path
        Files that numbered files must not replace.
    seen : Seen
        Called for each pose that is written.
    """
    from sshade.cli.notes import stored_positions
    from sshade.files.gltf_morph import write_morphs
    from sshade.files.meshes import write_file
    from sshade.mesh.surface import as_single

    count = len(times)
    with progress_bar(remaining="poses") as progress:
        if not has_number(output):

            def poses() -> Iterator[np.ndarray]:
                before = None
                for number in range(count):
                    progress("poses", number, count)
                    before = solve(number, before)
                    seen(number, before, as_single(before))
                    yield before
                progress("poses", count, count)

            write_morphs(output, file, poses(), times)
            return f"{output}: {_poses(count)}"
        paths = [numbered(output, number) for number in range(count)]
        # A comparison of all files with all inputs would take minutes for thousands of poses.
        taken = {identity(path) for path in inputs} - {None}
        for path in paths:
            check_output(path, SUFFIXES, inputs=inputs if identity(path) in taken else (), overwrite=None)
        before = None
        for number, path in enumerate(paths):
            progress("poses", number, count)
            V = solve(number, before)
            write_file(path, file, V)
            before = stored_positions(path, file, V)
            seen(number, V, before)
        progress("poses", count, count)
    further = numbered(output, count)
    stays = f"; {further} is of an earlier, longer sequence, and stays" if further.exists() else ""
    return f"{paths[0]} to {paths[-1]}: {_poses(count)}{stays}"


def _poses(count: int) -> str:
    return f"{count} pose{'s' * (count > 1)}"


def placed_handles(files: list[HandleFile], paths: list[Path], shape: OpenShape) -> list[Handles]:
    """Place the handles of all poses on the surface of a shape.

    Raises
    ------
    InputError
        When handles do not fit the mesh, or differ between poses. The message names the file.
    """
    from sshade.files.handles_on_mesh import on_shape  # imports large libraries

    poses: list[Handles] = []
    for path, file in zip(paths, files, strict=True):
        with naming(path):
            poses.append(on_shape(file, shape))
            poses[-1].require_same(poses[0])
    return poses


def deform_poses(options: argparse.Namespace, values: dict[str, Any], resolved: Options) -> int:
    """Deform a mesh for the poses of a sequence, and write the output; return the exit code."""
    inputs = [options.mesh, *options.handles]
    check_sequence(options, inputs)
    files = [read_handle_file(path, raw=options.raw) for path in options.handles]
    if not has_number(options.output):
        check_output(options.output, MORPHS, inputs=options.handles, overwrite=None)
    return _deform(options, values, resolved, files, inputs)


@announced_compilation()
def _deform(
    options: argparse.Namespace,
    values: dict[str, Any],
    resolved: Options,
    files: list[HandleFile],
    inputs: list[Path],
) -> int:
    """Read the mesh, deform it for all poses, and write the output."""
    from sshade.cli.notes import (
        announced_warnings,
        notes,
        reached,
        rounding_notes,
        unused_options,
        warnings_of,
    )
    from sshade.files.handles_on_mesh import handle_notes
    from sshade.method.dense_handles import are_dense
    from sshade.method.sequence import Sequence
    from sshade.problem.task import DeformationResult

    file, shape = open_mesh(options, options.output)
    mesh, poses = shape.mesh, placed_handles(files, options.handles, shape)
    if options.weight is not None:
        poses = [softened(handles, options.weight) for handles in poses]
    task = shape.task(options.mesh.stem, poses[0], carry_unconstrained=options.carry_unconstrained)
    sequence = Sequence(task, method=options.method, **values)
    results: list[DeformationResult] = []

    def solve(number: int, before: np.ndarray | None) -> np.ndarray:
        after = None if before is None else (poses[number - 1], shape.surface.picked(before))
        with naming(options.handles[number]):
            result = sequence(poses[number], after=after)
        results.append(replace(result, vertices=np.empty((0, 3))))
        return shape.placed(result.vertices)

    errors, moves = [0.0], [0.0]

    def seen(number: int, V: np.ndarray, stored: np.ndarray) -> None:
        errors.append(reached(stored, shape.surface, poses[number])[1])
        moves.append(float(np.linalg.norm(stored - V, axis=1).max()))

    begin = perf_counter()
    with announced_warnings():
        times = np.arange(len(poses)) / options.fps
        written = write_poses(options.output, file, solve, times, inputs, seen)
    seconds = perf_counter() - begin
    each = f", {seconds / len(results):.2f} s each"
    if poses[0].hard.any():
        each = f", hard handles reached to {100 * max(errors):.2g} % of the diagonal{each}"
    say(f"{written}, {len(file.V)} vertices{each}, {seconds:.2f} s")
    for note in unused_options(options, options.handles[0], files[0]):
        say(f"note: {note}")
    rounding = max(moves)
    for warning in warnings_of(
        max(errors), rounding=rounding / mesh.diagonal, exact=options.method != "paper"
    ):
        say(f"warning: {warning}")
    snap = max(float(handles.snap_distance.max()) for handles in poses)
    dense = options.method != "interpolate" and are_dense(task)
    found = [result.facts for result in results]
    facts = replace(
        found[0],
        gap=max(one.gap for one in found),
        side_gap=max(one.side_gap for one in found),
        opening=max(one.opening for one in found),
    )
    for note in [
        *rounding_notes(file, (options.mesh, options.output), moved=rounding, diagonal=mesh.diagonal),
        *handle_notes(files[0], poses[0], mesh),
        *notes(facts, shape.surface, asked=resolved.vertices, snap=snap, dense=dense),
    ]:
        say(f"note: {note}")
    if alone := sum(not one.followed for one in found[1:]):
        far = "is far from the pose before, and started as a single run does"
        far = far if alone == 1 else "are far from the poses before, and started as single runs do"
        say(f"note: {_poses(alone)} {far}")
    if missed := sum(result.converged is False for result in results):
        say(f"note: the iterations of {_poses(missed)} did not converge")
    return 0


def softened(handles: Handles, weight: float) -> Handles:
    """Return handles whose hard positions are soft, with a weight."""
    return replace(handles, weight=np.where(handles.hard, weight, handles.weight))
