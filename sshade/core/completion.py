"""Scripts that complete the arguments of a program in a shell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


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
