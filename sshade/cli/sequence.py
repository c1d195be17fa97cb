"""Sequences of poses in ``sshade deform``: several handle files, and numbered meshes or one glTF file."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from sshade.cli.arguments import NUMBER, OpenTask, check_outputs, has_number
from sshade.core.atomic import check_output, identity, naming
from sshade.core.console import progress_bar, say
from sshade.core.errors import InputError, counted
from sshade.files.by_library import WRITABLE
from sshade.files.mesh_file import MORPHS, MeshFile
from sshade.problem.options import Options

#: Poses per second.
FPS = 24.0
#: ``seen(number, V, stored)`` is told the positions (n, 3) of a pose, and the positions that its file holds.
Seen = Callable[[int, np.ndarray, np.ndarray], None]
#: ``solve(number, before)`` returns the positions of a pose in the order of the mesh file. `before` are the
#: stored positions of the pose before, None where the pose is the first.
Solve = Callable[[int, "np.ndarray | None"], np.ndarray]


def numbered(pattern: Path, number: int) -> Path:
    """Return the path of a pose, counted from 0; files are numbered from 1."""
    return pattern.with_name(NUMBER.sub(lambda place: place.group() % (number + 1), pattern.name))


def check_sequence(options: argparse.Namespace) -> None:
    """Raise InputError unless the output can hold several poses, can be written, and is no input.

    Without --fps, `options` get the default.
    """
    options.fps = FPS if options.fps is None else options.fps
    if not options.fps > 0 or not np.isfinite(options.fps):
        raise InputError(f"--fps takes a number above 0, not {options.fps:g}")
    output, known = options.output, WRITABLE if has_number(options.output) else MORPHS
    if known is MORPHS and output.suffix.lower() in WRITABLE and output.suffix.lower() not in MORPHS:
        raise InputError(
            f"{output}: one such file cannot hold a sequence; number the files, as in "
            f"{output.stem}_%04d{output.suffix}, or write .glb"
        )
    check_outputs(options, output=known)
    if known is MORPHS:
        check_output(output, known, inputs=options.handles, overwrite=None)


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
            check_output(path, WRITABLE, inputs=inputs if identity(path) in taken else (), overwrite=None)
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
    return counted(count, "pose", "poses")


def deform_poses(
    options: argparse.Namespace, opened: OpenTask, values: dict[str, Any], resolved: Options
) -> None:
    """Deform a mesh for the poses of a sequence, and write the output."""
    from sshade.cli.notes import announced_warnings, reached, tell
    from sshade.method.sequence import Sequence
    from sshade.problem.task import DeformationResult

    file, shape, _, poses, task = opened
    sequence = Sequence(task, method=options.method, **values)
    results: list[DeformationResult] = []

    def solve(number: int, before: np.ndarray | None) -> np.ndarray:
        after = None if before is None else (poses[number - 1], shape.surface.picked(before))
        with naming(options.handles[number]):
            result = sequence(poses[number], after=after)
        results.append(replace(result, vertices=np.empty((0, 3))))
        stays = options.amount == 0 and not resolved.volume_goal
        return file.V if stays else shape.placed(result.vertices)

    errors, moves = [0.0], [0.0]

    def seen(number: int, V: np.ndarray, stored: np.ndarray) -> None:
        errors.append(reached(stored, shape.surface, poses[number])[1])
        moves.append(float(np.linalg.norm(stored - V, axis=1).max()))

    begin = perf_counter()
    with announced_warnings():
        times = np.arange(len(poses)) / options.fps
        inputs = [options.mesh, *options.handles]
        written = write_poses(options.output, file, solve, times, inputs, seen)
    seconds = perf_counter() - begin
    each = f", {seconds / len(results):.2f} s each"
    if poses[0].hard.any():
        each = f", handles at most {100 * max(errors):.2g} % of the diagonal from target{each}"
    say(f"{written}, {len(file.V)} vertices{each}, {seconds:.2f} s")
    found = [result.facts for result in results]
    facts = replace(
        found[0],
        gap=max(one.gap for one in found),
        side_gap=max(one.side_gap for one in found),
        opening=max(one.opening for one in found),
    )
    tell(options, opened, facts, asked=resolved.vertices, error=max(errors), rounding=max(moves))
    if alone := sum(not one.followed for one in found[1:]):
        far = "is far from the pose before, and started as a single run does"
        far = far if alone == 1 else "are far from the poses before, and started as single runs do"
        say(f"note: {_poses(alone)} {far}")
    if missed := sum(result.converged is False for result in results):
        say(f"note: the iterations of {_poses(missed)} did not converge")
