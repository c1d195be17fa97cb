"""The command ``sshade``: a sub-command a module, see :mod:`sshade.cli.programs`."""

from __future__ import annotations

from sshade.cli.programs import Program

PROGRAM = Program(
    name="sshade",
    commands={
        "deform": ("sshade.cli.deform", "move handles, and the mesh with them"),
        "edit": ("sshade.cli.edit", "pick and drag regions in a browser"),
        "show": ("sshade.cli.show", "look at a mesh, its handles and a result"),
        "remesh": ("sshade.cli.remesh", "write a proxy and its map"),
        "carry": ("sshade.cli.carry", "carry an edited proxy back to the mesh"),
        "reconstruct": ("sshade.cli.reconstruct", "rebuild a known pose from its samples"),
        "transfer-pose": ("sshade.cli.transfer_pose", "put an edited shape into a known pose"),
    },
    text="""\
Deform large meshes by moving a few handles.

{commands}

  sshade deform body.ply pose.json -o posed.ply
  sshade show body.ply pose.json --deformed posed.ply -o posed.png

`sshade COMMAND --help` tells more. Exit codes: 0; 2 for a mistake in the arguments or the files, told in one
sentence.
""",
)
main = PROGRAM.main
