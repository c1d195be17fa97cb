"""Sequences of poses in ``sshade deform``, and outputs of sequences, also for ``sshade transfer-pose``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.cli.arguments import read_surface
from sshade.cli.console import announced_compilation, progress_bar, say
from sshade.errors import InputError
from sshade.io.document import CACHES, MORPHS, SUFFIXES, MeshFile
from sshade.io.files import check_output, identity, naming
from sshade.io.numbered import NumberedFiles, chained_keys, has_number, input_checksum
from sshade.io.poses import Poses, is_animation, read_poses
from sshade.options import Options

if TYPE_CHECKING:
    from sshade.handles import Handles

#: Poses per second of files without times, and samples per second of a glTF animation.
FPS = 24.0
#: ``seen(number, V, stored)`` is told the positions (n, 3) of a pose, and the positions that its file holds.
Seen = Callable[[int, np.ndarray, np.ndarray], None]
#: ``solve(number, before)`` returns the positions of a pose in the order of the mesh file. `before` are the
#: stored positions of the pose before, None where the pose is the first.
Solve = Callable[[int, "np.ndarray | None"], np.ndarray]


def add_fps(parser: argparse.ArgumentParser, text: str) -> None:
    """Declare --fps."""
    parser.add_argument("--fps", type=float, metavar="F", help=f"{text} (default: {FPS:g})")


def is_sequence_output(path: Path) -> bool:
    """Whether a name stands for several poses: it has a number, or the suffix of a point cache."""
    return has_number(path) or path.suffix.lower() in CACHES


def is_sequence(options: argparse.Namespace) -> bool:
    """Whether the arguments of ``sshade deform`` ask for a sequence."""
    several = len(options.handles) > 1 or options.animation is not None
    return several or is_sequence_output(options.output) or is_animation(options.handles[0])


def require_no_fps(options: argparse.Namespace) -> None:
    """Raise InputError if a command that writes one pose was given --fps."""
    if getattr(options, "fps", None) is not None:
        raise InputError("--fps applies to sequences, and these arguments give one pose")


def check_sequence(options: argparse.Namespace, inputs: list[Path]) -> None:
    """Raise InputError unless the output can hold several poses, can be written, and is no input."""
    options.fps = FPS if options.fps is None else options.fps
    if not options.fps > 0 or not np.isfinite(options.fps):
        raise InputError(f"--fps takes a number above 0, not {options.fps:g}")
    output, numbered = options.output, has_number(options.output)
    known = SUFFIXES if numbered else (*MORPHS, *CACHES)
    if not numbered and output.suffix.lower() in SUFFIXES and output.suffix.lower() not in MORPHS:
        raise InputError(
            f"{output}: one such file cannot hold a sequence; number the files, as in "
            f"{output.stem}_%04d{output.suffix}, or write .glb, .pc2 or .mdd"
        )
    check_output(output, known, inputs=inputs, overwrite=options.overwrite)


def write_poses(
    output: Path,
    file: MeshFile,
    solve: Solve,
    keys: list[str],
    times: np.ndarray,
    inputs: list[Path],
    seen: Seen = lambda number, V, stored: None,
) -> str:
    """Solve and write all poses; return the files and the number of poses, for the summary.

    Parameters
    ----------
    output : path
    file : MeshFile
        At rest.
    solve : Solve
    keys : list of str
        Key of each pose, see :class:`sshade.io.numbered.NumberedFiles`.
    times : (k,) float64
        In seconds.
    inputs : list of path
        Files that numbered files must not replace.
    seen : Seen
        Called for each pose that is written.
    """
    from sshade.cli.accuracy import read_back, stored_positions
    from sshade.io.gltf_morph import write_morphs
    from sshade.io.point_cache import write_point_cache
    from sshade.mesh.surface import as_single

    count = len(keys)
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

            if output.suffix.lower() in MORPHS:
                write_morphs(output, file, poses(), times)
            else:
                write_point_cache(output, poses(), vertices=len(file.V), times=times)
            lost = output.suffix.lower() == ".pc2" and not np.allclose(np.diff(times, n=2), 0)
            return f"{output}: {_poses(count)}{' without their times, which .mdd and .glb keep' * lost}"
        files = NumberedFiles(output, keys)
        # A comparison of all files with all inputs would take minutes for thousands of poses.
        taken = {identity(path) for path in inputs} - {None}
        for path, suffixes in [
            (files.record, (".json",)),
            *((files.path(i), SUFFIXES) for i in range(count)),
        ]:
            check_output(path, suffixes, inputs=inputs if identity(path) in taken else (), overwrite=None)
        before = read_back(files.path(files.kept - 1), file) if 0 < files.kept < count else None
        for number in range(files.kept, count):
            progress("poses", number, count)
            V = solve(number, before)
            path = files.write(file, V)
            before = stored_positions(path, file, V)
            seen(number, V, before)
        progress("poses", count, count)
    kept = f", {files.kept} of them kept from an earlier run" if files.kept else ""
    if files.path(count).exists():
        kept += f"; {files.path(count)} is of an earlier, longer sequence, and stays"
    return f"{files.path(0)} to {files.path(count - 1)}: {_poses(count)}{kept}"


def _poses(count: int) -> str:
    return f"{count} pose{'s' * (count > 1)}"


def inputs_key(mesh: Path, **values: Any) -> str:
    """Return a text that changes with the mesh file, the version and the given values."""
    from sshade import __version__

    values |= {"mesh": input_checksum(mesh), "version": __version__}
    return json.dumps(values, sort_keys=True, default=lambda value: np.asarray(value).tolist())


def deform_poses(options: argparse.Namespace, values: dict[str, Any], resolved: Options) -> int:
    """Deform a mesh for the poses of a sequence, and write the output; return the exit code."""
    inputs = [options.mesh, *options.handles, *([options.animation] if options.animation else [])]
    check_sequence(options, inputs)
    given = read_poses(options.handles, animation=options.animation, raw=options.raw, fps=options.fps)
    if not has_number(options.output):
        check_output(options.output, (*MORPHS, *CACHES), inputs=inputs[1:], overwrite=None)
    return _deform(options, values, resolved, given, inputs)


@announced_compilation()
def _deform(
    options: argparse.Namespace,
    values: dict[str, Any],
    resolved: Options,
    given: Poses,
    inputs: list[Path],
) -> int:
    """Read the mesh, deform it for all poses, and write the output."""
    from sshade.cli.accuracy import reached, rounding_notes, warnings_of
    from sshade.cli.notes import announced_warnings, notes, unused_options
    from sshade.io.handles import handle_notes
    from sshade.options import PAPER
    from sshade.pipeline.dense_handles import are_dense
    from sshade.pipeline.sequence import Sequence
    from sshade.task import DeformationResult, DeformationTask

    file, whole = read_surface(options, output_of_contents(options.output))
    mesh, files = whole.mesh, [pose.file for pose in given.poses]
    poses = given.on(whole)
    if options.weight is not None:
        poses = [softened(handles, options.weight) for handles in poses]
    carry = {"carry_unconstrained": options.carry_unconstrained}
    tasks = DeformationTask(options.mesh.stem, mesh, poses[0], **carry)
    sequence = Sequence(tasks, method=options.method, **values)
    results: list[DeformationResult] = []

    def solve(number: int, before: np.ndarray | None) -> np.ndarray:
        after = None if before is None else (poses[number - 1], whole.picked(before))
        with naming(given.poses[number].name):
            result = sequence(poses[number], after=after)
        results.append(replace(result, vertices=np.empty((0, 3))))
        return whole.placed(file.V, result.vertices)

    errors, moves = [0.0], [0.0]

    def seen(number: int, V: np.ndarray, stored: np.ndarray) -> None:
        errors.append(reached(stored, whole, poses[number])[1])
        moves.append(float(np.linalg.norm(stored - V, axis=1).max()))

    kept = {name: value for name, value in values.items() if name != "workers"}
    asked = {**kept, "method": options.method, **carry, "weld": options.weld, "repair": options.repair}
    text = inputs_key(options.mesh, **asked)
    begin = perf_counter()
    with announced_warnings():
        written = write_poses(
            options.output,
            file,
            solve,
            chained_keys(text, map(_contents, poses)),
            given.times,
            inputs,
            seen,
        )
    seconds = perf_counter() - begin
    each = f", {seconds / len(results):.2f} s each" if results else ""
    if results and poses[0].hard.any():
        each = f", hard handles reached to {100 * max(errors):.2g} % of the diagonal{each}"
    say(f"{written}, {len(file.V)} vertices{each}, {seconds:.2f} s")
    for note in [*given.notes, *unused_options(options, options.handles[0], files[0])]:
        say(f"note: {note}")
    if not results:
        return 0
    rounding = max(moves)
    for warning in warnings_of(
        max(errors), rounding=rounding / mesh.diagonal, exact=options.method not in PAPER
    ):
        say(f"warning: {warning}")
    facts = {"asked": resolved.vertices, "diagonal": mesh.diagonal}
    facts["snap"] = max(float(handles.snap_distance.max()) for handles in poses)
    facts["dense"] = options.method != "interpolate" and are_dense(tasks)
    for name in ("gap", "side_gap", "opening"):
        facts[name] = max(result.extra.get(name, 0.0) for result in results)
    for note in [
        *rounding_notes(file, (options.mesh, options.output), moved=rounding, diagonal=mesh.diagonal),
        *handle_notes(files[0], poses[0], mesh),
        *notes({**results[0].extra, **whole.facts, **facts}),
    ]:
        say(f"note: {note}")
    later = results[1:] if len(results) == len(poses) else results
    if alone := sum(not result.extra["followed"] for result in later):
        far = "is far from the pose before, and started as a single run does"
        far = far if alone == 1 else "are far from the poses before, and started as single runs do"
        say(f"note: {_poses(alone)} {far}")
    if missed := sum(result.converged is False for result in results):
        say(f"note: the iterations of {_poses(missed)} did not converge")
    return 0


def output_of_contents(output: Path) -> Path | None:
    """Return the output whose format decides which contents are lost; None for a point cache."""
    return None if output.suffix.lower() in CACHES else output


def softened(handles: Handles, weight: float) -> Handles:
    """Return handles whose hard positions are soft, with a weight."""
    return replace(handles, weight=np.where(handles.hard, weight, handles.weight))


def _contents(handles: Handles) -> bytes:
    """Return bytes that change with the handles of a pose and their targets."""
    arrays = handles.index, handles.target, handles.group, handles.weight, handles.rotation
    return b"".join(b"" if array is None else array.tobytes() for array in arrays)
