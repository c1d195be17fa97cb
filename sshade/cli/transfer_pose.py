"""Transfer a known pose to an edited shape, through the samples of proxies:

  sshade transfer-pose rest.ply posed.ply edited.ply -o edited_posed.ply

moves edited.ply, an edited copy of rest.ply, into the pose of posed.ply. All files have the same number of
vertices, in the same order. The output has the contents of EDITED.

POSED may be several files, or a folder of meshes: a sequence of poses, in the order of their names, in which
pose_2 comes before pose_10. OUT is then a name with a number, a .glb with a morph target for each pose and an
animation, or a .pc2 or .mdd point cache:

  sshade transfer-pose rest.ply poses/ edited.ply -o out_%04d.ply

With --marks, EDITED is any other mesh. Its vertices need not correspond. Marks are places on MESH (source)
and EDITED (target) that correspond, as ids of vertices or as positions:

  sshade transfer-pose cat.ply walk/ horse.ply --marks marks.json -o horse.glb

  {"marks": [{"name": "nose", "source": 12, "target": 345},
             {"name": "left ear", "source": [x, y, z], "target": [x, y, z]}, ...]}
"""

from __future__ import annotations

import argparse
from pathlib import Path
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
    corresponding,
    read,
    read_surface,
)
from sshade.cli.console import announced_compilation, progress_bar, say
from sshade.cli.sequence import add_fps, is_sequence_output, require_no_fps
from sshade.cli.transfer_sequence import DEFAULTS, OPTIONS, posed_files, transfer_poses
from sshade.errors import counted
from sshade.io.document import SUFFIXES, check_input
from sshade.options import PROXIES, checked

POSED, EDITED = "the same vertices in a pose", "rest shape with moved vertices; with --marks, any mesh"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    shapes = {"posed": f"{POSED}; several, or a folder, for a sequence", "edited": EDITED}
    add_files(parser, output="OUT", several=("posed",), mesh=REST, **shapes)
    text = "transfer only the edit: vertices that were not edited end exactly at their places in POSED"
    add_flags(parser, {"--residual": text})
    text = "places on MESH and on EDITED that correspond (.json); EDITED is then any mesh, deformed by the "
    text += "method fast; of the options below, --seed and --workers apply"
    parser.add_argument("--marks", type=Path, metavar="FILE", help=text)
    add_fps(parser, "poses per second of a sequence in OUT")
    add_options(parser, OPTIONS, further=("residual",), **DEFAULTS)
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Transfer the pose to the edited shape, or to the rest shape if `options` have no edited shape."""
    if "marks" in options:
        posed = posed_files(options.posed)
        if len(posed) > 1 or options.marks is not None or is_sequence_output(options.output):
            return transfer_poses(options, posed)
        (options.posed,) = posed
    require_no_fps(options)
    check_outputs(options, output=SUFFIXES)
    sampling = checked({name: getattr(options, name) for name in OPTIONS}, PROXIES, subject="transfer")
    for name in ("mesh", "posed", "edited"):
        if name in options:
            check_input(getattr(options, name), SUFFIXES)
    return _transfer(options, sampling)


@announced_compilation()
def _transfer(options: argparse.Namespace, sampling: dict[str, Any]) -> int:
    """Read the shapes, transfer the pose, and write the output."""
    from sshade.io.meshes import write_file
    from sshade.pipeline.transfer import transfer_pose

    path: Any = getattr(options, "edited", None)
    shape = read(options.posed)
    # The output has the contents of EDITED, or of MESH without it.
    edit = None if path is None else read(path, options.output)
    file, whole = read_surface(options, options.output if edit is None else None)
    mesh = whole.mesh
    posed = corresponding(shape, options.posed, file, options.mesh, whole)
    edited = None if edit is None else corresponding(edit, path, file, options.mesh, whole)
    begin = perf_counter()
    with progress_bar() as progress:
        residual = options.residual
        result = transfer_pose(mesh, posed, edited, residual=residual, progress=progress, **sampling)
    seconds = perf_counter() - begin
    write_file(options.output, edit or file, whole.placed(shape.V, result.vertices))
    proxies = counted(options.samplings, "proxy", "proxies")
    say(f"{options.output}: {len(file.V)} vertices, {proxies}, {seconds:.2f} s")
    if edited is None:
        error = np.linalg.norm(result.vertices - posed, axis=1) / mesh.diagonal
        say(
            f"distance to {options.posed}: {100 * error.mean():.2g} % of the diagonal in the mean, "
            f"{100 * error.max():.2g} % at most"
        )
    return 0
