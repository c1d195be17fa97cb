"""Transfer a known pose to an edited shape, through the samples of proxies:

  sshade transfer-pose rest.ply posed.ply edited.ply -o edited_posed.ply

moves edited.ply, an edited copy of rest.ply, into the pose of posed.ply. All files have the same number of
vertices, in the same order. The output has the contents of EDITED.
"""

from __future__ import annotations

import argparse
from time import perf_counter
from typing import Any

import numpy as np

from sshade.cli.arguments import (
    REST,
    add_files,
    add_flags,
    add_options,
    add_repair,
    check_outputs,
    open_mesh,
    read,
)
from sshade.cli.correspondence import corresponding, moved_by
from sshade.core.console import announced_compilation, progress_bar, say
from sshade.core.errors import counted
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.problem.options import PROXIES, TRANSFER_SAMPLINGS, Options, checked

POSED, EDITED = "the same vertices in a pose", "rest shape with moved vertices"
#: Options of sampling and frames, with their defaults.
DEFAULTS: dict[str, Any] = {
    "vertices": Options.vertices,
    "samplings": TRANSFER_SAMPLINGS,
    "frames": "triangle",
    "seed": 0,
}
OPTIONS = (*DEFAULTS, "workers")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_files(parser, output="OUT", mesh=REST, posed=POSED, edited=EDITED)
    text = "transfer only the edit: vertices that were not edited end exactly at their places in POSED"
    add_flags(parser, {"--residual": text})
    add_options(parser, OPTIONS, DEFAULTS)
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Transfer the pose to the edited shape, or to the rest shape if `options` have no edited shape."""
    check_outputs(options, output=WRITABLE)
    checked({name: getattr(options, name) for name in OPTIONS}, PROXIES, subject="transfer")
    for name in ("mesh", "posed", "edited"):
        if name in options:
            check_mesh(getattr(options, name))
    return _transfer(options)


@announced_compilation()
def _transfer(options: argparse.Namespace) -> int:
    """Read the shapes, transfer the pose, and write the output."""
    from sshade.files.meshes import write_file
    from sshade.method.transfer import transfer_pose

    path: Any = getattr(options, "edited", None)
    pose = read(options.posed)
    # The output has the contents of EDITED, or of MESH without it.
    edit = None if path is None else read(path, options.output)
    file, shape = open_mesh(options, options.output if edit is None else None)
    mesh = shape.mesh
    posed = corresponding(pose, options.posed, shape, options.mesh)
    edited = None if edit is None else corresponding(edit, path, shape, options.mesh)
    begin = perf_counter()
    with progress_bar() as progress:
        result = transfer_pose(
            mesh,
            posed,
            edited,
            residual=options.residual,
            vertices=options.vertices,
            samplings=options.samplings,
            frames=options.frames,
            seed=options.seed,
            workers=options.workers,
            progress=progress,
        )
    seconds = perf_counter() - begin
    write_file(options.output, edit or file, shape.surface.placed(pose.V, result.vertices))
    proxies = counted(options.samplings, "proxy", "proxies")
    say(f"{options.output}: {len(file.V)} vertices, {proxies}, {seconds:.2f} s")
    if edited is not None and moved_by(mesh, edited) > moved_by(mesh, posed):
        say(f"note: {path} is farther from {options.mesh} than {options.posed}; the pose comes first")
    if edited is None:
        error = np.linalg.norm(result.vertices - posed, axis=1) / mesh.diagonal
        say(
            f"distance to {options.posed}: {100 * error.mean():.2g} % of the diagonal in the mean, "
            f"{100 * error.max():.2g} % at most"
        )
    return 0
