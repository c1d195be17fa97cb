"""Apply the edits of a proxy from `sshade remesh` to the mesh:

sshade remesh body.ply -o proxy.ply --map map.npz
... move vertices of proxy.ply, keeping their order ...
sshade carry body.ply map.npz edited.ply -o posed.ply
"""

from __future__ import annotations

import argparse

from sshade.cli.arguments import (
    add_files,
    add_options,
    add_repair,
    check_outputs,
    open_mesh,
    read,
)
from sshade.cli.correspondence import require_finite, require_same_order
from sshade.core.console import announced_compilation, say
from sshade.core.errors import InputError
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.files.mesh_file import check_input


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_files(
        parser,
        output="OUT",
        mesh="mesh that was remeshed",
        map=".npz map from `sshade remesh`",
        edited="proxy with moved vertices",
    )
    add_options(parser, ("frames",), {"frames": "triangle"})
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Write the output; return the exit code."""
    check_outputs(options, output=WRITABLE)
    check_mesh(options.mesh)
    check_input(options.map, (".npz",))
    check_mesh(options.edited)
    return _carry(options)


@announced_compilation()
def _carry(options: argparse.Namespace) -> int:
    """Read the files, carry the mesh, and write the output."""
    from sshade.files.meshes import write_file
    from sshade.mesh.cutting import cut_surface, mean_of_copies
    from sshade.proxy.binding_file import load_binding

    proxy = read(options.edited)
    edited = proxy.V
    require_finite(edited, options.edited)
    file, shape = open_mesh(options, options.output)
    cut = cut_surface(shape.mesh)
    binding = load_binding(options.map, cut.mesh, frames=options.frames)
    if len(edited) != binding.proxy.n:
        count = f"{options.edited} has {len(edited)} vertices and the proxy of {options.map} has"
        raise InputError(f"{count} {binding.proxy.n}; they must correspond")
    require_same_order(proxy, options.edited, binding.proxy.F, f"the proxy of {options.map}")
    V, degenerate = binding.carry(edited)
    write_file(options.output, file, shape.placed(mean_of_copies(cut, V)))
    say(f"{options.output}: {len(file.V)} vertices carried by {binding.proxy.n}")
    if degenerate:
        say(f"note: {degenerate} frames of the proxy have no area; they rotate with their neighbours")
    return 0
