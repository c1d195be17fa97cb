"""Programs with sub-commands. The module of a sub-command is imported only when the sub-command is called.

Such a module has a docstring, which is the help text, and functions ``add_arguments(parser)`` and
``command(options)``, which returns the exit code.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple


def version_of(program: str) -> str:
    """Return the text of ``--version``; all programs have the version of the package."""
    from importlib.metadata import version

    return f"{program} {version('sshade')}"


class PrintCompletion(argparse.Action):
    """Print a script that completes the arguments of a parser and its sub-parsers in a shell, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, _: Any, shell: Any, __: Any = None) -> None:
        import shtab

        _prepare(parser, shtab.FILE)
        print(shtab.complete(parser, shell))  # noqa: T201
        parser.exit()


def _prepare(parser: argparse.ArgumentParser, file: Any) -> None:
    """Have values of type Path completed as files, and choices in a form that shtab reads."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub_parser in action.choices.values():
                _prepare(sub_parser, file)
        elif action.choices is not None:
            action.choices = list(action.choices)
        elif action.type is Path:
            action.complete = file  # type: ignore[attr-defined]


def add_completion(parser: argparse.ArgumentParser) -> None:
    """Declare ``--print-completion``."""
    text = "print a script that completes arguments in this shell"
    shells = ("bash", "zsh", "tcsh")
    parser.add_argument("--print-completion", action=PrintCompletion, choices=shells, help=text)


class Program(NamedTuple):
    """A program with sub-commands.

    Attributes
    ----------
    name : str
    commands : mapping
        Module and one-line summary of each sub-command.
    text : str
        Help text, with ``{commands}`` for the list of sub-commands.
    extras : mapping
        Extras that bring libraries of the program; see :func:`sshade.core.console.missing_library`.
    """

    name: str
    commands: Mapping[str, tuple[str, str]]
    text: str
    extras: Mapping[str, str] = {}

    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the command line; return the exit code."""
        name, *arguments = (sys.argv[1:] if argv is None else argv) or [""]
        try:
            from sshade.core.console import run_command

            if name in ("-h", "--help", "--version"):
                return run_command(lambda: self.tell(name))
            if name == "--print-completion":
                return run_command(lambda: self.complete(arguments), extras=self.extras)
            return run_command(partial(self.call, name, arguments), extras=self.extras)
        except KeyboardInterrupt:  # while libraries are imported
            print("interrupted", file=sys.stderr)  # noqa: T201
            return 130

    @property
    def help(self) -> str:
        """Text of ``--help``."""
        width = max(map(len, self.commands))
        lines = (f"  {name:<{width}} {summary}" for name, (_, summary) in self.commands.items())
        return self.text.format(commands="\n".join(lines))

    def tell(self, name: str) -> int:
        """Print the version or the help text."""
        print(f"{version_of(self.name)}\n" if name == "--version" else self.help, end="")  # noqa: T201
        return 0

    def complete(self, arguments: Sequence[str]) -> int:
        """Print the script of ``--print-completion SHELL``. This imports the modules of all sub-commands."""
        self.parser().parse_args(["--print-completion", *arguments])
        return 0

    def parser(self) -> argparse.ArgumentParser:
        """Return a parser of all sub-commands. This imports the modules of all sub-commands."""
        from sshade.core.console import CommandParser

        parser = CommandParser(prog=self.name)
        add_completion(parser)
        commands = parser.add_subparsers()
        for name, (module_name, summary) in self.commands.items():
            command, module = commands.add_parser(name, help=summary), import_module(module_name)
            if hasattr(module, "add_arguments"):
                module.add_arguments(command)
        return parser

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
            from sshade.core.errors import InputError

            found = f"{name!r} is no command" if name else "a command is missing"
            raise InputError(f"{found}; use {self.name} {'|'.join(self.commands)}; see `{self.name} --help`")
        module = import_module(self.commands[name][0])
        if not hasattr(module, "add_arguments"):  # a Hydra program, which reads sys.argv
            sys.argv[:] = [f"{self.name} {name}", *arguments]
            return module.main()
        from sshade.core.console import CommandParser

        parser = CommandParser(
            prog=f"{self.name} {name}",
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(parser)
        options = parser.parse_args(arguments)
        if "with_file" in options:  # a file may give values that the arguments leave out
            options = options.with_file(parser, options, arguments)
        return module.command(options)
