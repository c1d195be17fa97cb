"""Edit a mesh in the browser: pick regions, fix some, drag and turn others, and the mesh follows.

The page opens at a secret address of this machine; --no-browser only prints the address. HANDLES gives the
first groups, as for `sshade deform`. The editor saves the handles and the deformed mesh beside MESH, or at
the paths of -o and --handles-out. The saved handle file also has the method and all options, so that
`sshade deform MESH SAVED_HANDLES -o OUT` computes the same shape, and `sshade edit MESH SAVED_HANDLES`
continues the session.
The program runs until you click End on the page or press Ctrl-C; closing the page does not end it. Unsaved
work is kept in a recovery file beside the handles, which the next start offers.

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
    REFUSE,
    add_flags,
    add_mesh_and_handles,
    add_repair,
    check_outputs,
    require_mesh_first,
)
from sshade.cli.saved_options import take_saved_options
from sshade.core.console import announced_compilation, say
from sshade.core.errors import InputError
from sshade.files.by_library import WRITABLE, check_mesh
from sshade.files.handle_files import read_handle_file
from sshade.problem.options import require_method

if TYPE_CHECKING:
    from sshade.edit.server import Server


#: Largest time in seconds for a computation to end before the command does.
PATIENCE = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    output = "deformed mesh to write (default: MESH's name, _deformed)"
    add_mesh_and_handles(parser, output="OUT", text=output)
    saved = "handle file to write (default: MESH's name, _handles.json)"
    parser.add_argument("--handles-out", type=Path, metavar="JSON", help=saved)
    method = "fast (default), fine or paper: method of the converged shape; the page can change it"
    parser.add_argument("--method", metavar="METHOD", help=method)
    parser.add_argument("--port", type=int, default=0, metavar="P", help="port (default: any free port)")
    up = "axis of the mesh that points up on the page (default: y)"
    parser.add_argument("--up", choices=("y", "z"), default="y", help=up)
    # --overwrite does not apply to the mesh: the saved handles belong to it.
    # The page switches volume and area.
    parser.set_defaults(inputs=("handles",), volume=None, area=None)
    browser = "do not open a browser, only print the address"
    add_flags(parser, {"--refuse-unconstrained": REFUSE, "--no-browser": browser})
    add_repair(parser)


def command(options: argparse.Namespace) -> int:
    """Serve the editor until it is closed; return the exit code."""
    if not 0 <= options.port < 65536:
        raise InputError(f"a port is a number up to 65535, not {options.port}")
    if options.handles is not None:
        require_mesh_first(options.mesh, [options.handles])
    check_mesh(options.mesh)
    if options.handles is not None:
        given = read_handle_file(options.handles)
        for name in ("volume", "area"):
            if given.made.get(name):
                raise InputError(f"{options.handles}: the editor keeps the {name} or not; use 0 or nothing")
        take_saved_options(options, options.handles, given)
    options.method = require_method(options.method or "fast")
    check_outputs(options, output=WRITABLE, handles_out=(".json",))
    return _edit(options)


def _edit(options: argparse.Namespace) -> int:
    """Read the files, and serve the editor."""
    from sshade.edit.server import Server
    from sshade.edit.session import Session
    from sshade.edit.state import METHODS, Settings

    method = require_method(options.method, METHODS)
    settings = Settings(method, volume=options.volume is None, area=options.area is None)
    files = {"handles": options.handles, "output": options.output, "handles_output": options.handles_out}
    with announced_compilation():
        further = {name: getattr(options, name) for name in ("refuse_unconstrained", "weld", "repair")}
        session = Session(options.mesh, **files, settings=settings, **further)
    for note in session.document.notes:
        say(f"note: {options.mesh}: {note}")
    for offer in session.recovery.offers:
        when = strftime("%d %b, %H:%M", localtime(offer.time))
        say(f"note: {offer.path} has unsaved work of {when}; recover it on the page")
    server = Server(session, port=options.port, up=options.up)
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
    with server:
        print(server.address, flush=True)  # noqa: T201
        if browser and not webbrowser.open(server.address):
            say("note: no browser could be opened; open the address in one")
        say("The editor runs until you click End on its page or press Ctrl-C here.")
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            say("")
        server.close()
