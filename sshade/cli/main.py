"""Deform large meshes by moving a few handles.

{commands}

  sshade deform body.ply pose.json -o posed.ply
  sshade show body.ply pose.json posed.ply

`defaust example DIR` writes a body and handle files, to try.

`sshade COMMAND --help` describes a command. Exit codes: 0 on success; 2 for a mistake in the arguments or the
files, reported in one sentence; 130 after Ctrl-C, and 143 after SIGTERM.
"""

from __future__ import annotations

from sshade.core.console import Program

COMMANDS = {
    "deform": ("sshade.cli.deform", "deform a mesh so that its handles reach their targets"),
    "edit": ("sshade.cli.edit", "pick and drag regions of a mesh in a browser"),
    "show": ("sshade.cli.show", "show a mesh, its handles and results in the browser"),
    "remesh": ("sshade.cli.remesh", "write a proxy of a mesh, and the map back to the mesh"),
    "carry": ("sshade.cli.carry", "carry an edited proxy back to the mesh"),
    "reconstruct": ("sshade.cli.reconstruct", "rebuild a known pose from its samples"),
    "blender": ("sshade.cli.blender", "build an extension for Blender"),
    "transfer-pose": ("sshade.cli.transfer_pose", "put an edited shape into a known pose"),
}
PROGRAM = Program(name="sshade", commands=COMMANDS, text=__doc__ or "")
main = PROGRAM.main
