"""Edit a mesh in the browser: pick regions, fix some, drag and turn others, and the mesh follows.

The page opens at a secret address of this machine; --no-browser only prints the address. HANDLES gives the
first groups, as for `sshade deform`. The editor saves the handles and the deformed mesh beside MESH, or at
the paths of -o and --handles-out. The saved handle file also has the method and all options, so that
`sshade deform MESH SAVED_HANDLES -o OUT` computes the same shape, and `sshade edit MESH SAVED_HANDLES`
continues the session.
The program runs until you click End on the page or press Ctrl-C; closing the page does not end it. Unsaved
work is kept in a recovery file beside MESH, which the next start offers.

examples:
  sshade edit body.ply
  sshade edit body.ply pose.json -o posed.ply --handles-out pose_2.json
"""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path
from time import localtime, strftime
from typing import TYPE_CHECKING

from sshade.cli.arguments import (
    HANDLES,
    REST,
    add_flags,
    add_overwrite,
    add_repair,
    check_outputs,
    require_mesh_first,
    take_saved_options,
)
from sshade.core.console import announced_compilation, compilation_told, say
from sshade.core.errors import InputError
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.files.handle_files import read_handle_file
from sshade.problem.options import accepted, require_method

if TYPE_CHECKING:
    from sshade.edit.server import Server

#: Methods of the editor.
METHODS = ("fast", "fine", "paper")
#: Largest time in seconds for a computation to end before the command does.
PATIENCE = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("mesh", type=Path, metavar="MESH", help=REST)
    parser.add_argument("handles", type=Path, nargs="?", metavar="HANDLES", help=HANDLES)
    output = "deformed mesh to write (default: MESH's name, _deformed)"
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help=output)
    # --overwrite does not apply to the mesh: the saved handles belong to it.
    add_overwrite(parser, ("handles",))
    saved = "handle file to write (default: MESH's name, _handles.json)"
    parser.add_argument("--handles-out", type=Path, metavar="JSON", help=saved)
    method = "fast (default), fine or paper: method of the converged shape; the page can change it"
    parser.add_argument("--method", metavar="METHOD", help=method)
    parser.add_argument("--port", type=int, default=0, metavar="P", help="port (default: any free port)")
    add_flags(parser, {"--no-browser": "do not open a browser, only print the address"})
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Serve the editor until it is closed; return the exit code."""
    if not 0 <= options.port < 65536:
        raise InputError(f"a port is a number up to 65535, not {options.port}")
    require_mesh_first(options.mesh, [options.handles] if options.handles else [])
    check_mesh(options.mesh)
    if options.handles is not None:
        take_saved_options(options, options.handles, read_handle_file(options.handles))
    options.method = require_method(options.method or "fast", METHODS)
    check_outputs(options, output=WRITABLE, handles_out=(".json",))
    return _edit(options)


def _edit(options: argparse.Namespace) -> int:
    """Read the files, and serve the editor."""
    from sshade.edit.document import Document
    from sshade.edit.server import Server
    from sshade.edit.session import Session

    with announced_compilation():
        document = Document(
            options.mesh,
            output=options.output,
            handles=options.handles_out,
            weld=options.weld,
            repair=options.repair,
        )
        own = {
            name: x for name in accepted(options.method) if (x := getattr(options, name, None)) is not None
        }
        session = Session(document, options.method, options.handles, own)
    for note in document.notes:
        say(f"note: {options.mesh}: {note}")
    for offer in session.recovery.offers:
        when = strftime("%d %b, %H:%M", localtime(offer.time))
        say(f"note: {offer.path} has unsaved work of {when}; recover it on the page")
    server = Server(session, port=options.port)
    try:
        _serve(server, browser=not options.no_browser)
    finally:  # also when a signal ends the program
        if session.is_unsaved:
            kept = session.trouble or f"{session.recovery.path} keeps them for the next start"
            say(f"note: the handles were not saved; {kept}")
        session.end(PATIENCE)
    return 0


def _serve(server: Server, *, browser: bool) -> None:
    """Serve the editor until it is closed."""
    from sshade.cli.notes import announced_warnings

    with server, compilation_told(server.compiling), announced_warnings():
        print(server.address, flush=True)  # noqa: T201
        if browser and not webbrowser.open(server.address):
            say("note: no browser could be opened; open the address in one")
        say("The editor runs until you click End on its page or press Ctrl-C here.")
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            say("")
        server.close()
