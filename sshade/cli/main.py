"""The command ``sshade``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, get_args

import numpy as np

from sshade.carry.kinds import FrameKind
from sshade.cli.console import (
    CommandParser,
    add_command,
    announced_compilation,
    progress_bar,
    run_command,
    say,
)
from sshade.cli.notes import notes
from sshade.cli.show import add_show
from sshade.errors import InputError
from sshade.io.document import MeshFile
from sshade.io.files import check_output, replacing
from sshade.io.meshes import (
    SUFFIXES,
    mesh_of,
    read_arrays,
    read_file,
    read_mesh,
    repair,
    write_file,
    write_mesh,
)
from sshade.mesh.seams import join_seams
from sshade.mesh.surface import Surface, surface

if TYPE_CHECKING:
    from sshade.task import DeformationResult

#: Proxy vertices by default: those of :mod:`sshade.pipeline.proxies` and :mod:`sshade.pipeline.fast`,
#: written out because these take long to import.
VERTICES, BETTER = 6000, 12_000


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""

    def run() -> int:
        arguments = _parser().parse_args(argv)
        with announced_compilation():
            arguments.run(arguments)
        return 0

    return run_command(run)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="sshade", description="Deform large meshes through a small proxy (SShaDe).")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    formats = ", ".join(SUFFIXES)

    deform = add_command(commands, "deform", _deform, "move handles, and the mesh with them")
    _add_files(deform, output="OUT", mesh=f"rest shape ({formats})", handles="handle file (.json, .yaml)")
    deform.add_argument(
        "--method",
        choices=("sshade_fast", "sshade_fine", "sshade"),
        default="sshade_fast",
        help="one proxy, with volume and area held (default); the same, then a polish at full resolution, "
        "some ten times slower; or the method as published, five proxies averaged",
    )
    _add_vertices(deform, default=None, text=f"{BETTER}; {VERTICES} with --method sshade")
    _add_samplings(deform, default=None)
    deform.add_argument(
        "--start",
        choices=("rest", "rigid"),
        default="rigid",
        help="where the solver begins: the best rigid motion of the rest shape, or the rest shape, as the "
        "paper, which is slower and may end in a fold where the handles turn far (default: rigid)",
    )
    deform.add_argument(
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
        deform.add_argument(flag, action="store_true", help=text)

    remesh = add_command(commands, "remesh", _remesh, "write a proxy and its map")
    _add_files(remesh, output="N", mesh=f"mesh to sample ({formats})")
    remesh.add_argument("--map", type=Path, required=True, metavar="MAP", help=".npz map to write")
    _add_vertices(remesh)

    carry = add_command(commands, "carry", _carry, "carry an edited proxy back to the mesh")
    _add_files(
        carry,
        output="OUT",
        mesh="the mesh that was remeshed",
        map="the .npz of `sshade remesh`",
        edited="the proxy with vertices moved",
    )
    _add_frames(carry)

    rest, posed = f"rest shape ({formats})", "the same vertices in a pose"
    rebuild = add_command(commands, "reconstruct", _transfer, "rebuild a known pose from its samples")
    _add_files(rebuild, output="OUT", mesh=rest, posed=posed)
    pose = add_command(commands, "transfer-pose", _transfer, "put an edited shape into a known pose")
    _add_files(pose, output="OUT", mesh=rest, posed=posed, edited="the rest shape with vertices moved")
    pose.add_argument(
        "--residual",
        action="store_true",
        help="carry the edit alone: what was not edited ends exactly on POSED",
    )
    rebuild.set_defaults(residual=False)
    for command in (rebuild, pose):
        _add_vertices(command)
        _add_samplings(command, default=10)
        _add_frames(command)
    add_show(commands)
    return parser


def _add_files(parser: argparse.ArgumentParser, *, output: str, **positional: str) -> None:
    """Paths by name with what they are, and the -o that is called `output`."""
    for name, text in positional.items():
        parser.add_argument(name, type=Path, metavar=name.upper(), help=text)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar=output, help="mesh to write")


def _add_samplings(parser: argparse.ArgumentParser, *, default: int | None) -> None:
    usual = "the method's own" if default is None else f"{default}, as the paper"
    parser.add_argument(
        "--samplings", type=int, default=default, metavar="K", help=f"proxies averaged (default: {usual})"
    )
    parser.add_argument("--workers", type=int, metavar="W", help="threads (default: two a processor)")


def _add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--frames",
        choices=get_args(FrameKind),
        default="triangle",
        help="what carries the mesh along: rigid frames of the proxy's triangles, as the paper, their "
        "affine maps, or frames at the proxy's vertices, blended (default: triangle)",
    )


def _add_vertices(
    parser: argparse.ArgumentParser, *, default: int | None = VERTICES, text: str = str(VERTICES)
) -> None:
    parser.add_argument(
        "--vertices",
        type=int,
        default=default,
        metavar="N",
        help=f"proxy vertices, a quarter of the mesh's at most (default: {text})",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the sampling (default: 0)")


def _deform(arguments: argparse.Namespace) -> None:
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
    from sshade.io.handles import read_handles
    from sshade.pipeline.deform import deform
    from sshade.task import DeformationTask

    check_output(arguments.output, SUFFIXES)
    method = _method(arguments)
    default = VERTICES if arguments.method == "sshade" else BETTER
    vertices = default if arguments.vertices is None else arguments.vertices
    file = _read(arguments.mesh, arguments.output)
    V = file.V
    try:
        whole = Surface(*repair(V, file.F), {}) if arguments.repair else surface(V, file.F)
    except InputError as mistake:
        raise InputError(f"{arguments.mesh}: {mistake}") from mistake
    mesh = whole.mesh
    handles = read_handles(arguments.handles, mesh, raw=arguments.raw, vertex=whole.vertex)
    if arguments.weight is not None:
        weight = np.where(handles.hard, arguments.weight, handles.weight)
        handles = replace(handles, weight=weight)
    task = DeformationTask(
        arguments.mesh.stem, mesh, handles, carry_unconstrained=arguments.carry_unconstrained
    )
    begin = perf_counter()
    with progress_bar() as progress:
        result = deform(
            task,
            method=method,
            vertices=vertices,
            workers=arguments.workers,
            seed=arguments.seed,
            progress=progress,
        )
    seconds = perf_counter() - begin
    write_file(arguments.output, file, whole.placed(V, result.vertices))
    error = np.linalg.norm(result.vertices[handles.index] - handles.target, axis=1).mean() / mesh.diagonal
    samplings = result.extra.get("samplings", 1)
    proxies = f"{samplings} proxies" if samplings > 1 else "a proxy"
    say(
        f"{arguments.output}: {len(V)} vertices, {len(handles)} handles reached to {100 * error:.2g} % of "
        f"the diagonal, {proxies} of {result.extra['proxy_vertices']:.0f} vertices, {seconds:.2f} s"
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
    if result.converged is False and arguments.method != "sshade_fine":
        say(
            f"note: the iterations stopped at {result.iterations:.0f} in the mean, "
            f"with a residual of {result.extra['residual']:.1e}"
        )


def _read(path: Path, output: Path) -> MeshFile:
    """A mesh file; what `output` cannot take over of it is said."""
    file = read_file(path)
    if lost := file.lost(output):
        say(f"note: {output} keeps no {' or '.join(lost)} of {path}: it is of another format")
    return file


def _method(arguments: argparse.Namespace) -> Callable[..., DeformationResult]:
    """The function that --method names, with the options of the command that it takes."""
    from sshade.pipeline.deform import METHODS
    from sshade.solver.local_global import local_global

    given = {} if arguments.samplings is None else {"samplings": arguments.samplings}
    if arguments.method == "sshade":
        return partial(METHODS["paper"], coarse=partial(local_global, start=arguments.start), **given)
    if arguments.method == "sshade_fast":
        return partial(METHODS["fast"], start=arguments.start, **given)
    if given:
        raise InputError("sshade_fine has one proxy, which it polishes: leave --samplings out")
    return partial(METHODS["fine"], start=arguments.start)


def _remesh(arguments: argparse.Namespace) -> None:
    """Write a proxy of a mesh to edit by hand or in any other program, and the map that
    carries the edit back:

      sshade remesh body.ply -o proxy.ply --map map.npz
      ... move vertices of proxy.ply, keeping their order ...
      sshade carry body.ply map.npz edited.ply -o posed.ply
    """
    from sshade.carry.binding_file import save_binding
    from sshade.pipeline.proxies import bind

    check_output(arguments.output, SUFFIXES)
    check_output(arguments.map, (".npz",))
    mesh, _ = join_seams(read_mesh(arguments.mesh))
    binding = bind(mesh, arguments.vertices, seed=arguments.seed)
    with replacing(arguments.map) as temporary:
        save_binding(temporary, binding)
        write_mesh(arguments.output, binding.proxy.V, binding.proxy.F)  # without it there shall be no map
    say(f"{arguments.output}: {binding.proxy.n} vertices, {binding.proxy.m} faces; map in {arguments.map}")


def _carry(arguments: argparse.Namespace) -> None:
    """Carry an edited proxy of `sshade remesh` back to the mesh:

    sshade remesh body.ply -o proxy.ply --map map.npz
    ... move vertices of proxy.ply, keeping their order ...
    sshade carry body.ply map.npz edited.ply -o posed.ply
    """
    from sshade.carry.binding_file import load_binding

    check_output(arguments.output, SUFFIXES)
    file = _read(arguments.mesh, arguments.output)
    mesh, vertex = join_seams(mesh_of(file, arguments.mesh))
    binding = load_binding(arguments.map, mesh, frames=arguments.frames)
    edited, _ = read_arrays(arguments.edited)
    if not np.isfinite(edited).all():
        raise InputError(f"{arguments.edited}: a vertex has a NaN or infinite coordinate")
    V, degenerate = binding.carry(edited)
    write_file(arguments.output, file, V[vertex])
    say(f"{arguments.output}: {len(vertex)} vertices carried by {binding.proxy.n}")
    if degenerate:
        say(f"note: {degenerate} frames of the proxy stand on no area; they turn with their neighbours")


def _transfer(arguments: argparse.Namespace) -> None:
    """Carry a pose that is known vertex by vertex through the proxies' samples:

      sshade reconstruct rest.ply posed.ply -o rebuilt.ply
          rebuilds posed.ply from its samples, to see what the proxy loses
      sshade transfer-pose rest.ply posed.ply edited.ply -o edited_posed.ply
          puts an edited copy of rest.ply into the pose of posed.ply

    All files have the same number of vertices, in the same order.
    """
    from sshade.pipeline.transfer import transfer_pose

    check_output(arguments.output, SUFFIXES)
    file = _read(arguments.mesh, arguments.output)
    mesh = mesh_of(file, arguments.mesh)
    posed, _ = read_arrays(arguments.posed)
    edited = read_arrays(arguments.edited)[0] if "edited" in arguments else mesh.V
    begin = perf_counter()
    with progress_bar() as progress:
        result = transfer_pose(
            mesh,
            posed,
            edited,
            vertices=arguments.vertices,
            samplings=arguments.samplings,
            frames=arguments.frames,
            residual=arguments.residual,
            workers=arguments.workers,
            seed=arguments.seed,
            progress=progress,
        )
    seconds = perf_counter() - begin
    write_file(arguments.output, file, result.vertices)
    say(f"{arguments.output}: {mesh.n} vertices, {arguments.samplings} proxies, {seconds:.2f} s")
    if edited is mesh.V:
        error = np.linalg.norm(result.vertices - posed, axis=1) / mesh.diagonal
        say(
            f"distance to {arguments.posed}: {100 * error.mean():.2g} % of the diagonal in the mean, "
            f"{100 * error.max():.2g} % at most"
        )
