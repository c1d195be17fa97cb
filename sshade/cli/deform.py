"""Deform a mesh so that its handles reach their targets.

HANDLES is a .json file of this project or a .yaml file of Implicit-ARAP. In JSON:

  {"handles": [
    {"landmark": "foot", "kind": "static",  "vertices": [12, 13, 14]},
    {"landmark": "hand", "kind": "dynamic", "source": [[x, y, z], ...],
                                            "target": [[x, y, z], ...]},
    {"landmark": "head", "kind": "dynamic", "boxes": [[[x, y, z], [x, y, z]], ...],
                                            "rotation": [[..], [..], [..]], "translation": [x, y, z]},
    {"landmark": "tail", "vertices": [99], "target": [[x, y, z]], "weight": 5, "rotation": [x, y, z, w]}]}

Handles are vertex ids, positions on the mesh (snapped to the nearest vertices), or regions: all
vertices in some boxes (lowest and highest corner), which go to R v + t. Those with a weight are soft:
they are pulled to their targets, with 1 about as strongly as the surface around holds them. A rotation, a
matrix or a quaternion [x, y, z, w] as in glTF, says how the surface turns at handles beside boxes.
The output is the file of the input with other positions and normals: texture coordinates, colours,
materials, groups, polygons and all else stay, where OUT is of the same format. Vertices that stand
twice along a seam move as one. Components are deformed each on its own, with its own handles.
Where the mesh is not manifold it is cut, and joined again.

examples:
  sshade deform body.ply pose.json -o posed.ply
  sshade deform scan.obj landmarks.json -o fitted.obj --weight 10
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from sshade.cli.arguments import FORMATS, add_files, add_samplings, add_vertices, read
from sshade.cli.console import announced_compilation, progress_bar, say
from sshade.cli.notes import notes
from sshade.errors import InputError
from sshade.io.files import check_output
from sshade.io.handles import read_handles
from sshade.io.meshes import SUFFIXES, repair, write_file
from sshade.mesh.surface import Surface, surface
from sshade.pipeline import fast, proxies
from sshade.pipeline.deform import METHODS, deform
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_files(parser, output="OUT", mesh=f"rest shape ({FORMATS})", handles="handle file (.json, .yaml)")
    parser.add_argument(
        "--method",
        choices=("sshade_fast", "sshade_fine", "sshade"),
        default="sshade_fast",
        help="one proxy, with volume and area held (default); the same, then a polish at full resolution, "
        "some ten times slower; or the method as published, five proxies averaged",
    )
    add_vertices(parser, default=None, text=f"{fast.VERTICES}; {proxies.VERTICES} with --method sshade")
    add_samplings(parser, default=None)
    parser.add_argument(
        "--start",
        choices=("rest", "rigid"),
        default="rigid",
        help="where the solver begins: the best rigid motion of the rest shape, or the rest shape, as the "
        "paper, which is slower and may end in a fold where the handles turn far (default: rigid)",
    )
    parser.add_argument(
        "--weight",
        type=float,
        metavar="W",
        help="pull the handles of each group to their targets instead of holding them there; 1 is about as "
        "strong as the surface, whatever its size and resolution (default: hard, or the file's own weights)",
    )
    flags = {
        "--raw": "take targets as they are, not moved by the snap",
        "--repair": "deform a copy with coincident vertices welded and unused ones dropped; the output still "
        "has the input's vertices",
        "--carry-unconstrained": "move components without handles rigidly with the nearest one, as eyes with "
        "a head",
    }
    for flag, text in flags.items():
        parser.add_argument(flag, action="store_true", help=text)


@announced_compilation()
def command(options: argparse.Namespace) -> int:
    """Write the output; return the exit code."""
    check_output(options.output, SUFFIXES)
    method = chosen(options)
    default = proxies.VERTICES if options.method == "sshade" else fast.VERTICES
    vertices = default if options.vertices is None else options.vertices
    file = read(options.mesh, options.output)
    V = file.V
    try:
        whole = Surface(*repair(V, file.F), {}) if options.repair else surface(V, file.F)
    except InputError as mistake:
        raise InputError(f"{options.mesh}: {mistake}") from mistake
    mesh = whole.mesh
    handles = read_handles(options.handles, mesh, raw=options.raw, vertex=whole.vertex)
    if options.weight is not None:
        weight = np.where(handles.hard, options.weight, handles.weight)
        handles = replace(handles, weight=weight)
    task = DeformationTask(options.mesh.stem, mesh, handles, carry_unconstrained=options.carry_unconstrained)
    begin = perf_counter()
    with progress_bar() as progress:
        result = deform(
            task,
            method=method,
            vertices=vertices,
            workers=options.workers,
            seed=options.seed,
            progress=progress,
        )
    seconds = perf_counter() - begin
    write_file(options.output, file, whole.placed(V, result.vertices))
    error = np.linalg.norm(result.vertices[handles.index] - handles.target, axis=1).mean() / mesh.diagonal
    samplings = result.extra.get("samplings", 1)
    of = f"{samplings} proxies" if samplings > 1 else "a proxy"
    say(
        f"{options.output}: {len(V)} vertices, {len(handles)} handles reached to {100 * error:.2g} % of "
        f"the diagonal, {of} of {result.extra['proxy_vertices']:.0f} vertices, {seconds:.2f} s"
    )
    snap = float(handles.snap_distance.max())
    facts = {
        **result.extra,
        **whole.facts,
        "asked": vertices,
        "snap": snap,
        "diagonal": mesh.diagonal,
    }
    for note in notes(facts):
        say(f"note: {note}")
    if result.converged is False and options.method != "sshade_fine":
        say(
            f"note: the iterations stopped at {result.iterations:.0f} in the mean, "
            f"with a residual of {result.extra['residual']:.1e}"
        )
    return 0


def chosen(options: argparse.Namespace) -> Callable[..., DeformationResult]:
    """The function that --method names, with the options of the command that it takes."""
    given = {} if options.samplings is None else {"samplings": options.samplings}
    if options.method == "sshade":
        return partial(METHODS["paper"], coarse=partial(local_global, start=options.start), **given)
    if options.method == "sshade_fast":
        return partial(METHODS["fast"], start=options.start, **given)
    if given:
        raise InputError("sshade_fine has one proxy, which it polishes: leave --samplings out")
    return partial(METHODS["fine"], start=options.start)
