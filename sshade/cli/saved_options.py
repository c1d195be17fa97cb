"""Options that the editor saved in a handle file, for the commands that read it."""

from __future__ import annotations

import argparse
from pathlib import Path

from sshade.core.console import say
from sshade.core.whole_files import naming
from sshade.files.handle_files import HandleFile
from sshade.files.json_yaml import require_known
from sshade.mesh.weld import check_weld
from sshade.problem.options import require_method

#: Options that the editor saves.
SAVED = ("method", "weld", "repair")


def take_saved_options(options: argparse.Namespace, path: Path, given: HandleFile) -> None:
    """Take the options of a handle file that the command line leaves out, and report them.

    Raises
    ------
    InputError
        On an option that the editor does not save, or a value out of its range.
    """
    made = given.made
    with naming(f'{path}, key "made"'):
        require_known(made, SAVED)
        require_method(made.get("method", "fast"))
        if "weld" in made:
            check_weld(made["weld"])
    taken = {name: value for name, value in made.items() if getattr(options, name) in (None, False)}
    for name, value in taken.items():
        setattr(options, name, value)
    if taken:
        listed = ", ".join(f"{name} {value}" for name, value in taken.items())
        say(f"note: {path} was saved by the editor with {listed}; switches change this")
