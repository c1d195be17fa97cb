"""Sequences of poses in ``sshade deform``: several handle files, and numbered meshes or one glTF file."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from sshade.cli.arguments import NUMBER, OpenTask, check_outputs, has_number
from sshade.core.console import progress_bar, say
from sshade.core.errors import InputError, counted
from sshade.core.whole_files import check_output
from sshade.files.by_library import WRITABLE
from sshade.files.mesh_file import MORPHS
from sshade.problem.facts import Facts
from sshade.problem.options import Options

#: Poses per second.
FPS = 24.0


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


def _numbered(pattern: Path, count: int) -> list[Path]:
    """Return the paths of the poses, numbered from 1."""

    def name(number: int) -> str:
        return NUMBER.sub(lambda place: place.group() % number, pattern.name)

    return [pattern.with_name(name(number)) for number in range(1, count + 1)]


def deform_poses(options: argparse.Namespace, opened: OpenTask, resolved: Options) -> None:
    """Deform a mesh for the poses of a sequence, and write the output."""
    from sshade.cli.notes import announced_warnings, near_target, reached, stored_positions, tell
    from sshade.files.gltf_morph import write_morphs
    from sshade.files.meshes import write_file
    from sshade.mesh.quality import Gap, NearParts, worst
    from sshade.mesh.surface import as_single
    from sshade.method.bound import Bound
    from sshade.method.sequence import solved_poses
    from sshade.problem.task import DeformationResult

    file, shape, _, poses, task = opened
    output, count = options.output, len(poses)
    results: list[DeformationResult] = []
    errors, moves, parts = [0.0], [0.0], NearParts(shape.mesh)
    gaps: list[Gap | None] = []
    qualities = []
    bound = Bound.of_task(task, resolved, keep=True)

    def solved() -> Iterator[np.ndarray]:
        """Yield the positions of each pose in the order of the mesh file."""
        stays = options.amount == 0 and not resolved.volume_goal
        with progress_bar() as progress:
            progress("poses", 0, count)
            for result in solved_poses(bound, task, poses):
                results.append(replace(result, vertices=np.empty((0, 3))))
                gaps.append(parts.gap(result.vertices))
                qualities.append(bound.quality(result.vertices))
                progress("poses", len(results), count)
                yield file.V if stays else shape.placed(result.vertices)

    def measure(V: np.ndarray, stored: np.ndarray) -> None:
        """Measure where the handles of a pose are in its file, and how far its positions were rounded."""
        errors.append(reached(stored, shape.surface, poses[len(results) - 1])[1])
        moves.append(float(np.linalg.norm(stored - V, axis=1).max()))

    def measured() -> Iterator[np.ndarray]:
        for V in solved():
            measure(V, as_single(V))
            yield V

    begin = perf_counter()
    with announced_warnings():
        if has_number(output):
            paths = _numbered(output, count)
            for path in paths:
                check_output(path, WRITABLE, inputs=[options.mesh], overwrite=None)
            for path, V in zip(paths, solved(), strict=True):
                write_file(path, file, V)
                measure(V, stored_positions(path, file, V))
            written = f"{paths[0]} to {paths[-1]}"
        else:
            names = [handles.stem for handles in options.handles]
            write_morphs(output, file, measured(), np.arange(count) / options.fps, names)
            written = str(output)
    seconds = perf_counter() - begin
    each = f", {seconds / count:.2f} s each"
    if poses[0].hard.any():
        each = f", handles {near_target(max(errors))}{each}"
    say(f"{written}: {_poses(count)}, {len(file.V)} vertices{each}, {seconds:.2f} s")
    facts = _with_largest_gaps([result.facts for result in results])
    say(f"worst of all poses: {worst(qualities)}")
    tell(options, opened, facts, error=max(errors), rounding=max(moves), gaps=gaps)
    if missed := sum(result.converged is False for result in results):
        say(f"note: the iterations of {_poses(missed)} did not converge")


def _with_largest_gaps(facts: list[Facts]) -> Facts:
    """Return the facts of the first pose, with the largest gaps of all poses."""
    return replace(
        facts[0],
        gap=max(one.gap for one in facts),
        side_gap=max(one.side_gap for one in facts),
        opening=max(one.opening for one in facts),
    )


def _poses(count: int) -> str:
    return counted(count, "pose", "poses")
