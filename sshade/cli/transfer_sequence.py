"""Sequences of ``sshade transfer-pose``: onto an edited shape, or through marks onto any other mesh."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.cli.arguments import corresponding, read, read_surface
from sshade.cli.console import announced_compilation, say
from sshade.cli.sequence import (
    Solve,
    check_sequence,
    inputs_key,
    is_sequence_output,
    output_of_contents,
    require_no_fps,
    write_poses,
)
from sshade.errors import InputError
from sshade.io.document import SUFFIXES, MeshFile, check_input
from sshade.io.files import check_output, naming
from sshade.io.marks import Marks, read_marks
from sshade.io.numbered import chained_keys, input_checksum
from sshade.options import PROXIES, TRANSFER_SAMPLINGS, Options, checked

if TYPE_CHECKING:
    from sshade.handles import Handles
    from sshade.mesh.surface import Surface

#: Options of sampling and frames, with their defaults.
DEFAULTS: dict[str, Any] = {
    "vertices": Options.vertices,
    "samplings": TRANSFER_SAMPLINGS,
    "frames": "triangle",
    "seed": 0,
}
OPTIONS = (*DEFAULTS, "workers")
#: ``pose(number)`` returns the file of a pose, and the positions (k, 3) of the surface's vertices in it.
Pose = Callable[[int], tuple[MeshFile, np.ndarray]]


def posed_files(given: list[Path]) -> list[Path]:
    """Return the files of a sequence; a folder stands for the mesh files in it, in the order of their names.

    Numbers in names are compared as numbers: walk_2.ply comes before walk_10.ply. Hidden files do not count,
    such as those that macOS writes beside others.

    Raises
    ------
    InputError
        When a folder has no mesh files.
    """
    found: list[Path] = []
    for path in given:
        if not path.is_dir():
            found.append(path)
            continue
        shown = [one for one in path.iterdir() if not one.name.startswith(".")]
        inside = [one for one in shown if one.suffix.lower() in SUFFIXES and one.is_file()]
        inside.sort(key=_numbers_as_numbers)
        if not inside:
            raise InputError(f"{path}: the folder has no mesh files ({', '.join(SUFFIXES)})")
        found += inside
    return found


def _numbers_as_numbers(path: Path) -> list[tuple[bool, int, str]]:
    """Return the words and numbers of a name, for an order in which 2 comes before 10."""
    words = re.split(r"(\d+)", path.name)
    return [(word.isdecimal(), int(word) if word.isdecimal() else 0, word) for word in words]


def transfer_poses(options: argparse.Namespace, posed: list[Path]) -> int:
    """Transfer a sequence of poses, or a pose through marks; return the exit code."""
    inputs = [options.mesh, *posed, options.edited]
    if options.marks is not None:
        inputs.append(options.marks)
        given = [f"--{name}" for name, value in DEFAULTS.items() if getattr(options, name) != value]
        given = [name for name in given if name != "--seed"] + ["--residual"] * options.residual
        if given:
            raise InputError(f"{given[0]} does not apply with --marks, which samples no proxy of MESH")
    alone = len(posed) == 1 and not is_sequence_output(options.output)
    if alone:
        require_no_fps(options)
        check_output(options.output, SUFFIXES, inputs=inputs, overwrite=options.overwrite)
    else:
        check_sequence(options, inputs)
    sampling = checked({name: getattr(options, name) for name in OPTIONS}, PROXIES, subject="transfer")
    for path in (options.mesh, *posed, options.edited):
        check_input(path, SUFFIXES)
    marks = None if options.marks is None else read_marks(options.marks)
    return _transfer(options, posed, sampling, marks, alone=alone)


@announced_compilation()
def _transfer(
    options: argparse.Namespace,
    posed: list[Path],
    sampling: dict[str, Any],
    marks: Marks | None,
    *,
    alone: bool,
) -> int:
    """Read the shapes, transfer all poses, and write the output."""
    from sshade.io.meshes import read_file, write_file

    def pose(number: int) -> tuple[MeshFile, np.ndarray]:
        shape = read_file(posed[number])
        return shape, corresponding(shape, posed[number], file, options.mesh, whole)

    file, whole = read_surface(options)
    for path in posed:  # a bad file ends the command before it writes anything
        corresponding(read(path), path, file, options.mesh, whole)
    begin = perf_counter()
    output = read(options.edited, output_of_contents(options.output))
    if marks is None:
        edited = corresponding(output, options.edited, file, options.mesh, whole)
        solve = _onto_edited(options, sampling, edited, whole, pose)
    else:
        solve = _through_marks(options, marks, output, whole, pose)
    if alone:
        write_file(options.output, output, solve(0, None))
        written = f"{options.output}: 1 pose"
    else:
        seed = {"seed": options.seed} if marks is not None else sampling
        further = [options.edited, *([options.marks] if options.marks else [])]
        text = inputs_key(
            options.mesh,
            **{name: value for name, value in seed.items() if name != "workers"},
            further=[input_checksum(path) for path in further],
            flags=[options.residual, options.weld, options.repair],
        )
        keys = chained_keys(text, (input_checksum(path).encode() for path in posed))
        times = np.arange(len(posed)) / options.fps
        inputs = [options.mesh, *posed, *further]
        written = write_poses(options.output, output, solve, keys, times, inputs)
    say(f"{written}, {len(output.V)} vertices, {perf_counter() - begin:.2f} s")
    return 0


def _onto_edited(
    options: argparse.Namespace, sampling: dict[str, Any], edited: np.ndarray, whole: Surface, pose: Pose
) -> Solve:
    """Return a function that transfers a pose to the edited shape, which corresponds to the mesh."""
    from sshade.mesh.mesh import Mesh
    from sshade.pipeline.transfer import PoseTransfer

    with naming(options.edited):
        Mesh(edited, whole.mesh.F)
    transfer = PoseTransfer(whole.mesh, edited, residual=options.residual, **sampling)

    def solve(number: int, before: np.ndarray | None) -> np.ndarray:
        shape, V = pose(number)
        return whole.placed(shape.V, transfer(V).vertices)

    return solve


def _through_marks(
    options: argparse.Namespace, marks: Marks, output: MeshFile, whole: Surface, pose: Pose
) -> Solve:
    """Return a function that moves another mesh as the marks on a pose move."""
    from sshade.io.meshes import surface_of
    from sshade.pipeline.retarget import Retargeting
    from sshade.pipeline.sequence import Sequence

    other = surface_of(output, options.edited, weld=options.weld, repair=options.repair)
    with naming(options.marks):
        driver = Retargeting(whole.mesh, other.mesh, marks.on(whole, other))
    task = driver.task()
    sequence = Sequence(task, method="fast", seed=options.seed, workers=options.workers)

    @lru_cache(maxsize=2)  # of the pose, and of the pose before
    def handles_of(number: int) -> Handles:
        return task.handles.at(driver(pose(number)[1]))

    def solve(number: int, before: np.ndarray | None) -> np.ndarray:
        after = None if before is None else (handles_of(number - 1), other.picked(before))
        return other.placed(output.V, sequence(handles_of(number), after=after).vertices)

    return solve
