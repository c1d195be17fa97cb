"""Programs with sub-commands. The module of a sub-command is imported only when the sub-command is called.

Such a module has a docstring, which is the help text, and functions ``add_arguments(parser)`` and
``command(options)``, which returns the exit code.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import NamedTuple


def version_of(program: str) -> str:
    """Return the text of ``--version``; all programs have the version of the package."""
    from importlib.metadata import version

    return f"{program} {version('sshade')}"


class Program(NamedTuple):
    """A program with sub-commands.

    Attributes
    ----------
    name : str
    commands : mapping
        Module and one-line summary of each sub-command.
    text : str
        Help text, with ``{commands}`` for the list of sub-commands.
    """

    name: str
    commands: Mapping[str, tuple[str, str]]
    text: str

    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the command line; return the exit code."""
        name, *arguments = (sys.argv[1:] if argv is None else argv) or [""]
        if name in ("-h", "--help", "--version"):
            print(f"{version_of(self.name)}\n" if name == "--version" else self.help, end="")  # noqa: T201
            return 0
        try:
            from sshade.cli.console import run_command

            return run_command(lambda: self.call(name, arguments))
        except KeyboardInterrupt:  # while libraries are imported
            print("interrupted", file=sys.stderr)  # noqa: T201
            return 130

    @property
    def help(self) -> str:
        """Text of ``--help``."""
        width = max(map(len, self.commands))
        lines = (f"  {name:<{width}} {summary}" for name, (_, summary) in self.commands.items())
        return self.text.format(commands="\n".join(lines))

    def call(self, name: str, arguments: Sequence[str]) -> int:
        """Run a sub-command.

        Parameters
        ----------
        name : str
        arguments : sequence of str

        Returns
        -------
        int
            Exit code.

        Raises
        ------
        InputError
            On a mistake in the arguments or in a named file.
        """
        if name not in self.commands:
            from sshade.errors import InputError

            found = f"{name!r} is no command" if name else "a command is missing"
            raise InputError(f"{found}; use {self.name} {'|'.join(self.commands)}; see `{self.name} --help`")
        module = import_module(self.commands[name][0])
        if not hasattr(module, "add_arguments"):  # a Hydra program, which reads sys.argv
            sys.argv[:] = [f"{self.name} {name}", *arguments]
            return module.main()
        from sshade.cli.console import CommandParser

        parser = CommandParser(
            prog=f"{self.name} {name}",
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(parser)
        return module.command(parser.parse_args(arguments))
