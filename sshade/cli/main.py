"""The command ``sshade``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from sshade.carry.kinds import FrameKind
from sshade.cli.console import announced_compilation, progress_bar, run_command
from sshade.cli.show import add_show
from sshade.errors import InputError
from sshade.io.files import replacing
from sshade.io.meshes import SUFFIXES, check_output, read_arrays, read_mesh, repair, write_mesh

if TYPE_CHECKING:
    from sshade.task import DeformationResult

#: Proxy vertices by default; the paper's number.
VERTICES = 6000

DEFORM = """\
Deform a mesh so that its handles reach their targets.

HANDLES is a .json file of this project or a .yaml file of Implicit-ARAP. In JSON:

  {"handles": [
    {"landmark": "foot", "kind": "static",  "vertices": [12, 13, 14]},
    {"landmark": "hand", "kind": "dynamic", "source": [[x, y, z], ...],
                                            "target": [[x, y, z], ...]}]}

Handles are vertex ids, or positions on the mesh (snapped to the nearest vertices).
The output has the vertices and faces of the input, in the same order. Components are deformed
each on its own, with its own handles. Where the mesh is not manifold it is cut, and joined again.

example:
  sshade deform body.ply pose.json -o posed.ply
"""

REMESH = """\
Write a proxy of a mesh to edit by hand or in any other program, and the map that
carries the edit back:

  sshade remesh body.ply -o proxy.ply --map map.npz
  ... move vertices of proxy.ply, keeping their order ...
  sshade carry body.ply map.npz edited.ply -o posed.ply
"""


TRANSFER = """\
Carry a pose that is known vertex by vertex through the proxies' samples:

  sshade reconstruct rest.ply posed.ply -o rebuilt.ply
      rebuilds posed.ply from its samples, to see what the proxy loses
  sshade transfer-pose rest.ply posed.ply edited.ply -o edited_posed.ply
      puts an edited copy of rest.ply into the pose of posed.ply

All files have the same number of vertices, in the same order.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    arguments = _parser().parse_args(argv)

    def run() -> int:
        with announced_compilation():
            return arguments.run(arguments)

    return run_command(run)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sshade", description="Deform large meshes through a small proxy (SShaDe)."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    raw = argparse.RawDescriptionHelpFormatter
    formats = ", ".join(SUFFIXES)

    deform = commands.add_parser(
        "deform", help="move handles, and the mesh with them", description=DEFORM, formatter_class=raw
    )
    deform.add_argument("mesh", type=Path, metavar="MESH", help=f"rest shape ({formats})")
    deform.add_argument("handles", type=Path, metavar="HANDLES", help="handle file (.json, .yaml)")
    deform.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="mesh to write")
    deform.add_argument(
        "--method",
        choices=("sshade_fast", "sshade_fine", "sshade"),
        default="sshade_fast",
        help="one proxy, with volume and area held (default); the same, then a polish at full resolution, "
        "some ten times slower; or the method as published, five proxies averaged",
    )
    _add_vertices(deform)
    _add_samplings(deform, default=None)
    deform.add_argument(
        "--start",
        choices=("rest", "rigid"),
        default="rigid",
        help="where the solver begins: the best rigid motion of the rest shape, or the rest shape, as the "
        "paper, which is slower and may end in a fold where the handles turn far (default: rigid)",
    )
    deform.add_argument("--raw", action="store_true", help="take targets as they are, not moved by the snap")
    deform.add_argument(
        "--repair",
        action="store_true",
        help="deform a copy with coincident vertices welded and unused ones dropped; "
        "the output still has the input's vertices",
    )
    deform.add_argument(
        "--carry-loose",
        action="store_true",
        help="move components without handles rigidly with the nearest one, as eyes with a head",
    )
    deform.set_defaults(run=_deform)

    remesh = commands.add_parser(
        "remesh", help="write a proxy and its map", description=REMESH, formatter_class=raw
    )
    remesh.add_argument("mesh", type=Path, metavar="MESH", help=f"mesh to sample ({formats})")
    remesh.add_argument("-o", "--output", type=Path, required=True, metavar="N", help="proxy to write")
    remesh.add_argument("--map", type=Path, required=True, metavar="MAP", help=".npz map to write")
    _add_vertices(remesh)
    remesh.set_defaults(run=_remesh)

    carry = commands.add_parser(
        "carry", help="carry an edited proxy back to the mesh", description=REMESH, formatter_class=raw
    )
    carry.add_argument("mesh", type=Path, metavar="MESH", help="the mesh that was remeshed")
    carry.add_argument("map", type=Path, metavar="MAP", help="the .npz of `sshade remesh`")
    carry.add_argument("edited", type=Path, metavar="EDITED", help="the proxy with vertices moved")
    carry.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="mesh to write")
    _add_frames(carry)
    carry.set_defaults(run=_carry)
    rebuild = commands.add_parser(
        "reconstruct", help="rebuild a pose from its samples", description=TRANSFER, formatter_class=raw
    )
    pose = commands.add_parser(
        "transfer-pose", help="put an edited shape into a pose", description=TRANSFER, formatter_class=raw
    )
    for command in (rebuild, pose):
        command.add_argument("mesh", type=Path, metavar="REST", help="rest shape")
        command.add_argument("posed", type=Path, metavar="POSED", help="the same vertices in a pose")
    pose.add_argument("edited", type=Path, metavar="EDITED", help="the rest shape with vertices moved")
    pose.add_argument(
        "--residual",
        action="store_true",
        help="carry the edit alone: what was not edited ends exactly on POSED",
    )
    rebuild.set_defaults(residual=False)
    for command in (rebuild, pose):
        command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="mesh to write")
        _add_vertices(command)
        _add_samplings(command, default=10)
        _add_frames(command)
        command.set_defaults(run=_transfer)
    add_show(commands)
    return parser


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


def _add_vertices(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--vertices",
        type=int,
        metavar="N",
        help=f"proxy vertices (default: {VERTICES}, or a quarter of the mesh's where that is less)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the sampling (default: 0)")


def _proxy_vertices(asked: int | None, n: int, handles: int = 0) -> int:
    """The default leaves a small mesh a proxy that is worth the name, with room for the handles."""
    return asked if asked is not None else min(n, max(min(VERTICES, n // 4), handles + 4))


def _deform(arguments: argparse.Namespace) -> int:
    from sshade.io.handles import read_handles
    from sshade.pipeline.components import deform_components

    check_output(arguments.output)
    method = _method(arguments)
    if arguments.repair:
        V, F = read_arrays(arguments.mesh)
        mesh, vertex = repair(V, F)
    else:
        mesh = read_mesh(arguments.mesh)
        V, F, vertex = mesh.V, mesh.F, np.arange(mesh.n)
    handles = read_handles(arguments.handles, mesh, raw=arguments.raw, vertex=vertex)
    vertices = _proxy_vertices(arguments.vertices, mesh.n, len(handles))
    begin = perf_counter()
    with progress_bar() as progress:
        result = deform_components(
            mesh,
            handles,
            partial(method, workers=arguments.workers),
            vertices=vertices,
            carry_unconstrained=arguments.carry_loose,
            name=arguments.mesh.stem,
            seed=arguments.seed,
            progress=progress,
        )
    seconds = perf_counter() - begin
    moved = np.where((vertex >= 0)[:, None], result.vertices[vertex], V)
    write_mesh(arguments.output, moved, F)
    error = np.linalg.norm(result.vertices[handles.index] - handles.target, axis=1).mean() / mesh.diagonal
    samplings = result.extra.get("samplings", 1)
    proxies = f"{samplings} proxies" if samplings > 1 else "a proxy"
    _say(
        f"{arguments.output}: {len(V)} vertices, {len(handles)} handles reached to {100 * error:.2g} % of "
        f"the diagonal, {proxies} of {result.extra['proxy_vertices']:.0f} vertices, {seconds:.2f} s"
    )
    _say_of_components(result.extra)
    if result.converged is False and arguments.method != "sshade_fine":
        _say(
            f"note: the iterations stopped at {result.iterations:.0f} in the mean, "
            f"with a residual of {result.extra['residual']:.1e}"
        )
    return 0


def _say_of_components(facts: Mapping[str, Any]) -> None:
    """What was done besides, with a mesh that is no oriented manifold of one component."""
    if facts["copies"] or facts["turned"]:
        _say(
            f"note: no oriented manifold: {facts['turned']} faces were turned, {facts['copies']} copies of "
            f"vertices made, and joined over at most {100 * facts['gap']:.2g} % of the diagonal"
        )
    if facts["components"] > 1:
        _say(
            f"note: {facts['components']} components were deformed on their own, with shares of the proxy "
            "vertices"
        )
    if facts["unconstrained"]:
        _say(f"note: {facts['unconstrained']} components without handles follow the nearest one rigidly")
    left = facts.get("intersecting_or_inverted")
    if left:
        _say(f"note: {left} faces intersect others or are inverted, where handles force that")


def _method(arguments: argparse.Namespace) -> Callable[..., DeformationResult]:
    """The function of --method, with what the arguments say of it."""
    from sshade.pipeline.deform import deform
    from sshade.pipeline.fast import sshade_fast
    from sshade.pipeline.fine import sshade_fine
    from sshade.solver.local_global import local_global

    given = {} if arguments.samplings is None else {"samplings": arguments.samplings}
    if arguments.method == "sshade":
        return partial(deform, coarse=partial(local_global, start=arguments.start), **given)
    if arguments.method == "sshade_fast":
        return partial(sshade_fast, start=arguments.start, **given)
    if given:
        raise InputError("sshade_fine has one proxy, which it polishes: leave --samplings out")
    return partial(sshade_fine, start=arguments.start)


def _remesh(arguments: argparse.Namespace) -> int:
    from sshade.carry.binding_file import save_binding
    from sshade.pipeline.proxies import bind

    check_output(arguments.output)
    if arguments.map.suffix != ".npz" or not arguments.map.parent.is_dir():
        raise InputError(f"{arguments.map}: the map must be an .npz file in a folder that exists")
    mesh = read_mesh(arguments.mesh)
    binding = bind(mesh, _proxy_vertices(arguments.vertices, mesh.n), seed=arguments.seed)
    with replacing(arguments.map) as temporary:
        save_binding(temporary, binding)
        write_mesh(arguments.output, binding.proxy.V, binding.proxy.F)  # without it there shall be no map
    _say(f"{arguments.output}: {binding.proxy.n} vertices, {binding.proxy.m} faces; map in {arguments.map}")
    return 0


def _carry(arguments: argparse.Namespace) -> int:
    from sshade.carry.binding_file import load_binding

    check_output(arguments.output)
    mesh = read_mesh(arguments.mesh)
    binding = load_binding(arguments.map, mesh, frames=arguments.frames)
    edited, _ = read_arrays(arguments.edited)
    if not np.isfinite(edited).all():
        raise InputError(f"{arguments.edited}: a vertex has a NaN or infinite coordinate")
    V, degenerate = binding.carry(edited)
    write_mesh(arguments.output, V, mesh.F)
    _say(f"{arguments.output}: {mesh.n} vertices carried by {binding.proxy.n}")
    if degenerate:
        _say(f"note: {degenerate} frames of the proxy stand on no area; they turn with their neighbours")
    return 0


def _transfer(arguments: argparse.Namespace) -> int:
    from sshade.pipeline.transfer import transfer_pose

    check_output(arguments.output)
    mesh = read_mesh(arguments.mesh)
    posed, _ = read_arrays(arguments.posed)
    edited = read_arrays(arguments.edited)[0] if "edited" in arguments else mesh.V
    begin = perf_counter()
    with progress_bar() as progress:
        result = transfer_pose(
            mesh,
            posed,
            edited,
            vertices=_proxy_vertices(arguments.vertices, mesh.n),
            samplings=arguments.samplings,
            frames=arguments.frames,
            residual=arguments.residual,
            workers=arguments.workers,
            seed=arguments.seed,
            progress=progress,
        )
    seconds = perf_counter() - begin
    write_mesh(arguments.output, result.vertices, mesh.F)
    _say(f"{arguments.output}: {mesh.n} vertices, {arguments.samplings} proxies, {seconds:.2f} s")
    if edited is mesh.V:
        error = np.linalg.norm(result.vertices - posed, axis=1) / mesh.diagonal
        _say(
            f"distance to {arguments.posed}: {100 * error.mean():.2g} % of the diagonal in the mean, "
            f"{100 * error.max():.2g} % at most"
        )
    return 0


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201
