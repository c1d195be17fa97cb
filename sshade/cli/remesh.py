"""Write a proxy of a mesh, to be edited in any program, and the map that carries the edits back:

sshade remesh body.ply -o proxy.ply --map map.npz
... move vertices of proxy.ply, keeping their order ...
sshade carry body.ply map.npz edited.ply -o posed.ply
"""

from __future__ import annotations

import argparse
from pathlib import Path

from sshade.cli.arguments import FORMATS, add_files, add_options, add_repair, check_outputs, open_mesh
from sshade.core.console import announced_compilation, say
from sshade.core.whole_files import replacing
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.problem.options import PROXIES, Options, checked

OPTIONS = ("vertices", "seed")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_files(parser, output="PROXY", mesh=f"mesh to sample ({FORMATS})")
    parser.add_argument("--map", type=Path, required=True, metavar="MAP", help=".npz map to write")
    add_options(parser, OPTIONS, {"vertices": Options.vertices, "seed": 0})
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Write the output; return the exit code."""
    check_outputs(options, output=WRITABLE, map=(".npz",))
    checked({name: getattr(options, name) for name in OPTIONS}, PROXIES, subject="remesh")
    check_mesh(options.mesh)
    return _remesh(options)


@announced_compilation()
def _remesh(options: argparse.Namespace) -> int:
    """Read the mesh, and write the proxy and the map."""
    from sshade.files.meshes import write_mesh
    from sshade.mesh.cutting import cut_surface
    from sshade.proxy.bind import bind
    from sshade.proxy.binding_file import save_binding

    _, shape = open_mesh(options)
    cut = cut_surface(shape.mesh)
    binding = bind(cut.mesh, options.vertices, seed=options.seed)
    with replacing(options.map) as temporary:
        save_binding(temporary, binding)
        write_mesh(options.output, binding.proxy.V, binding.proxy.F)  # if this fails, no map is written
    say(f"{options.output}: {binding.proxy.n} vertices, {binding.proxy.m} faces; map in {options.map}")
    if (suffix := options.output.suffix.lower()) in (".stl", ".dae"):
        say(f"note: a {suffix} file keeps no order of vertices, so `sshade carry` cannot read the proxy back")
    if binding.proxy.n < options.vertices:
        say(f"note: the proxy has {binding.proxy.n} samples instead of {options.vertices}: the mesh is small")
    if cut.mesh is not shape.mesh:
        say("note: the mesh is no oriented manifold: the proxy is cut where the mesh is not, or turned")
    return 0
