"""Deform a mesh so that its handles reach their targets.

HANDLES says which vertices stay and where others move. `sshade edit` makes such a file, whose method and
options apply where no switch gives others. It is a .json file of
this project or a .yaml file of Implicit-ARAP, or two landmark files (.csv, .txt, .mrk.json, .fcsv, .pp,
.particles), of the rest shape and of the target. In JSON:

  {"handles": [
    {"name": "foot", "kind": "fixed", "vertices": [12, 13, 14]},
    {"name": "hand", "source": [[x, y, z], ...], "target": [[x, y, z], ...]},
    {"name": "head", "boxes": [[[x, y, z], [x, y, z]], ...],
     "rotation": [[..], [..], [..]], "translation": [x, y, z], "center": "centroid"},
    {"name": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}]}

Handles are vertex ids from 0, positions on the mesh (snapped to the nearest vertices), or all vertices in
some boxes (lowest and highest corner). They move to a target each, or together by a rotation R, a scale s and
a translation t: v moves to s R (v - c) + c + t. You can leave out some of them. The center c is a point or
"centroid"; by default it is the origin. Groups with a weight are soft: they are pulled to their targets, with
weight 1 about as strongly as the surface resists. Beside targets, a rotation prescribes the rotation of the
surface at the handles. Rotations are matrices, or quaternions [x, y, z, w] as in glTF. Keys of your own begin
with _; other unknown keys are refused.

Several handle files are a sequence of poses, in the order of the numbers in their names. The mesh is bound
once, and each pose starts from the pose before. OUT is a name with a number, as in out_%04d.ply, or a .glb
with a morph target for each pose and an animation. All poses have the same handles.

Meshes after --with go along with MESH, such as clothes and hair. They must lie on, inside or near it. Each is
written beside OUT, under a name that begins with OUT, with all its contents.

If OUT has the format of MESH, only positions and normals change: texture coordinates, colours, materials,
groups, polygons and all other contents stay. Vertices at one place along a seam move as one. Components are
deformed separately, each with its handles. A component without handles moves with the nearest one. A mesh
that is not manifold is cut, and joined again afterwards; a one-sided surface is covered twice instead.

methods:
  fast         one proxy with volume and area constraints (default)
  fine         fast with a polish at full resolution: three times slower at 170,000 vertices, eleven
               times at 1.8 million
  paper        the published method with an accelerated solver, the mean of five proxies
  interpolate  a smooth map through dense handles, without an elastic surface; takes no options

examples:
  sshade deform body.ply pose.json -o posed.ply
  sshade deform scan.obj landmarks.json -o fitted.obj --weight 10
  sshade deform skull.vtp rest.mrk.json target.mrk.json -o fitted.vtp --amount 0.5
  sshade deform body.ply poses/*.json -o out_%04d.ply
  sshade deform body.ply pose.json -o posed.ply --with shirt.obj hair.glb
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

from sshade.cli import along
from sshade.cli.arguments import (
    HANDLES,
    REST,
    add_files,
    add_flags,
    add_options,
    add_repair,
    check_outputs,
    has_number,
    open_task,
    require_mesh_first,
    take_saved_options,
)
from sshade.cli.sequence import FPS, check_sequence, deform_poses
from sshade.core.console import announced_compilation, progress_bar, say
from sshade.core.errors import InputError
from sshade.core.natural import in_natural_order
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.files.handle_files import pose_files, read_handle_file
from sshade.problem.options import GROUPS, Options, resolve

#: Arguments that --help tells; --help-all tells all.
USUAL = (
    *("output", "overwrite", "method", "joints", "vertices", "volume", "weight", "amount", "along", "seed"),
    *("weld", "repair", "verbose"),
)
#: Options of the methods that the command line can give.
OPTIONS = [name for names in GROUPS.values() for name in names if name != "proxy_method"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    handles = f"{HANDLES}, or two landmark files; several handle files for a sequence"
    add_files(parser, output="OUT", several=("handles",), mesh=REST, handles=handles)
    method = "fast (default), fine, paper or interpolate, see above"
    parser.add_argument("--method", metavar="METHOD", help=method)
    add_options(parser, OPTIONS)
    weight = "pull the handles softly to their targets; 1 is about as strong as the surface, at any size and "
    weight += "resolution (default: hard, or the weights of the file)"
    parser.add_argument("--weight", type=float, metavar="W", help=weight)
    amount = "fraction of the way that the handles move, 0 to 2; rotations have it of the angle (default: 1)"
    parser.add_argument("--amount", type=float, default=1.0, metavar="A", help=amount)
    refuse = "refuse components without handles; by default they move rigidly with the nearest component, as "
    refuse += "eyes with a head"
    add_flags(parser, {"--refuse-unconstrained": refuse})
    verbose = "tell every detail of the mesh and the handles, also where it changes little"
    add_flags(parser, {"--verbose": verbose})
    fps = f"poses per second of several handle files in a .glb or .gltf (default: {FPS:g})"
    parser.add_argument("--fps", type=float, metavar="F", help=fps)
    others = "other meshes, such as clothes or hair, that lie on, inside or near MESH and go along with it; "
    others += "with -o posed.ply, shirt.obj becomes posed_shirt.obj"
    parser.add_argument("--with", dest="along", nargs="+", type=Path, default=[], metavar="FILE", help=others)
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Write the output; return the exit code."""
    require_mesh_first(options.mesh, options.handles)
    poses = pose_files(options.handles)
    if len(poses) > 1 and (ordered := in_natural_order(options.handles)) != options.handles:
        options.handles, poses = ordered, pose_files(ordered)
        say(f"note: the poses go in the order of the numbers in their names, {ordered[0]} to {ordered[-1]}")
    sequence = len(poses) > 1 or has_number(options.output)
    if sequence and options.along:
        raise InputError("--with takes one pose; deform each pose of a sequence by a command of its own")
    if not sequence:
        if options.fps is not None:
            raise InputError("--fps applies to sequences, and these arguments give one pose")
        check_outputs(options, output=WRITABLE)
    names = along.outputs(options) if options.along else []
    check_mesh(options.mesh)
    if sequence:
        check_sequence(options)
    given = [read_handle_file(*files, amount=options.amount) for files in poses]
    take_saved_options(options, options.handles[0], given[0])
    options.method = options.method or "fast"
    resolved = _resolved(options)
    with announced_compilation():
        from sshade.cli.notes import announced_warnings, reached, stored_positions, tell
        from sshade.files.meshes import write_file
        from sshade.mesh.quality import NearParts
        from sshade.method.bound import Bound

        opened = open_task(options, given)
        if sequence:
            deform_poses(options, opened, resolved)
            return 0
        file, shape, _, (handles,), task = opened
        others = along.read_files(options.along, names, shape) if names else []
        begin = perf_counter()
        with progress_bar() as progress, announced_warnings():
            bound = Bound.of_task(task, resolved)
            result = bound.solve(task.handles, progress=progress)
        seconds = perf_counter() - begin
        stays = options.amount == 0 and not resolved.volume_goal
        placed = file.V if stays else shape.placed(result.vertices)
        write_file(options.output, file, placed)
        if others:
            along.write_files(others, shape.mesh, shape.mesh.V if stays else result.vertices)
        stored = stored_positions(options.output, file, placed)
        rounding = 0.0 if stored is placed else float(np.linalg.norm(stored - placed, axis=1).max())
        reach, error = reached(stored, shape.surface, handles)
        samplings, size = result.facts.samplings, result.facts.proxy_vertices
        proxies = f"{samplings} proxies" if samplings > 1 else "a proxy"
        proxies = f"{proxies} of {size:.0f} vertices" if size else "without a proxy"
        say(f"{options.output}: {len(file.V)} vertices, {reach}, {proxies}, {seconds:.2f} s")
        say(f"quality: {bound.quality(result.vertices)}")
        gap = NearParts(shape.mesh).gap(result.vertices)
        tell(options, opened, result.facts, error=error, rounding=rounding, gaps=[gap])
    if options.amount and task.is_at_rest and not resolved.volume_goal:
        say('note: no handle moves: give a group a "target", a "translation" or a "rotation"')
    if result.converged is False:
        say(
            f"note: the iterations did not converge: they stopped after {result.iterations:.0f} on average, "
            f"with a residual of {result.facts.residual:.1e}"
        )
    return 0


def _resolved(options: argparse.Namespace) -> Options:
    """Return the options of the method.

    Raises
    ------
    InputError
        When an option does not apply to the method, or a value is out of its range.
    """
    values = {name: getattr(options, name) for name in OPTIONS if getattr(options, name) is not None}
    resolved = resolve(options.method, values)
    if options.weight is not None and not options.weight > 0:
        raise InputError(f"--weight takes a number above 0, not {options.weight:g}")
    return resolved
