"""Options that the editor saved in a handle file, for the commands that read it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sshade.core.atomic import naming
from sshade.core.console import say
from sshade.core.errors import InputError
from sshade.files.handle_files import HandleFile
from sshade.files.handwritten import require_known
from sshade.mesh.weld import check_weld
from sshade.problem.options import described, require_method

#: Options that the editor saves.
SAVED = ("method", "volume", "area", "weld", "repair", "refuse_unconstrained")


def take_saved_options(options: argparse.Namespace, path: Path, given: HandleFile) -> None:
    """Take the options of a handle file that the command line leaves out, and report them.

    Raises
    ------
    InputError
        On an option that the editor does not save, or a value out of its range.
    """
    with naming(f'{path}, key "made"'):
        require_known(given.made, SAVED)
        for name, value in given.made.items():
            _require_valid(name, value)
    taken = {name: value for name, value in given.made.items() if getattr(options, name) in (None, False)}
    for name, value in taken.items():
        setattr(options, name, value)
    if taken:
        listed = ", ".join(f"{name} {value}" for name, value in taken.items())
        say(f"note: {path} was saved by the editor with {listed}; switches change this")


def _require_valid(name: str, value: Any) -> None:
    if name == "method":
        require_method(value)
    elif name == "weld":
        check_weld(value)
    elif name in ("volume", "area"):
        described()[name].checked(name, value)
    elif not isinstance(value, bool):
        raise InputError(f"{name} must be true or false, not {value!r}")
