"""Edit a mesh in the browser: pick regions, fix some, drag and turn others, and the mesh follows.

The page opens at a secret address of this machine; --no-browser only prints the address. HANDLES gives the
first groups, as for `sshade deform`. The editor saves the handles and the deformed mesh beside MESH, or at
the paths of -o and --handles-out. Then

  sshade deform MESH SAVED_HANDLES -o OUT

computes the same shape. The program ends when the page is closed, by its button End, or by Ctrl-C.

examples:
  sshade edit body.ply
  sshade edit body.ply pose.json -o posed.ply --handles-out pose_2.json
"""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from sshade.cli.arguments import CARRY, add_flags, add_mesh_and_handles
from sshade.cli.console import announced_compilation, say
from sshade.edit.server import Server
from sshade.edit.session import Session
from sshade.edit.state import METHODS, Settings
from sshade.errors import InputError
from sshade.io.files import reason
from sshade.options import require_method


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    output = "deformed mesh to write (default: MESH's name, _deformed)"
    add_mesh_and_handles(parser, output="OUT", text=output)
    saved = "handle file to write (default: MESH's name, _handles.json)"
    parser.add_argument("--handles-out", type=Path, metavar="JSON", help=saved)
    usual = Settings().method
    method = f"{', '.join(METHODS)}: method of the converged shape; the page can change it (default: {usual})"
    parser.add_argument("--method", default=usual, metavar="METHOD", help=method)
    parser.add_argument("--port", type=int, default=0, metavar="P", help="port (default: any free port)")
    browser = "do not open a browser, only print the address"
    add_flags(parser, {"--carry-unconstrained": CARRY, "--no-browser": browser})


def command(options: argparse.Namespace) -> int:
    """Serve the editor until it is closed; return the exit code."""
    with announced_compilation():
        files = {"handles": options.handles, "output": options.output, "handles_output": options.handles_out}
        settings, carry = Settings(require_method(options.method, METHODS)), options.carry_unconstrained
        session = Session(options.mesh, **files, settings=settings, carry_unconstrained=carry)
    if not 0 <= options.port < 65536:
        raise InputError(f"a port is a number up to 65535, not {options.port}")
    try:
        server = Server(session, port=options.port)
    except OSError as error:
        raise InputError(f"port {options.port} of this machine cannot be used ({reason(error)})") from error
    with server:
        print(server.address, flush=True)  # noqa: T201
        if not options.no_browser and not webbrowser.open(server.address):
            say("note: no browser could be opened; open the address in one")
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            say("")
        server.close()
    if session.is_unsaved:
        say("note: the handles were not saved")
    return 0
