"""Options of a method in a handle file, as the editor saves them, for the commands that read it."""

from __future__ import annotations

import argparse
from pathlib import Path

from sshade.core.console import say
from sshade.core.whole_files import naming
from sshade.files.handle_files import HandleFile
from sshade.mesh.weld import check_weld
from sshade.problem.options import accepted, require_method, resolve


def take_saved_options(options: argparse.Namespace, path: Path, given: HandleFile) -> None:
    """Take the options of a handle file that the command line leaves out, and report them.

    Raises
    ------
    InputError
        On an unknown option, or a value out of its range.
    """
    made = given.made
    of_method = {name: value for name, value in made.items() if name not in ("method", "weld", "repair")}
    with naming(f'{path}, key "made"'):
        resolve(require_method(made.get("method", "fast")), of_method)
        if "weld" in made:
            check_weld(made["weld"])
    foreign = {*of_method} - {*accepted(options.method or made.get("method", "fast"))}
    taken = {
        name: value
        for name, value in made.items()
        if name not in foreign
        and (getattr(options, name, None) is None or (name == "repair" and not options.repair))
    }
    for name, value in taken.items():
        setattr(options, name, value)
    if taken:
        listed = ", ".join(f"{name} {value}" for name, value in taken.items())
        say(f"note: {path} sets {listed}; switches change this")
