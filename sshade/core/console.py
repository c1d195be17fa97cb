"""Programs with sub-commands: what they print, their arguments, and how they end.

The module of a sub-command is imported only when the sub-command is called. Its docstring is the help text.
It has a function ``add_arguments(parser)``, and a function ``command(options)`` that returns the exit code.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import NamedTuple, NoReturn

from sshade.core.errors import InputError, meant, reason
from sshade.core.progress import Progress, silent

#: Extra that brings a library of this package, by the module that is imported.
EXTRAS = dict.fromkeys(("pyvista", "vtkmodules", "PIL"), "figures") | {"igl": "bench", "trimesh": "formats"}


class CommandParser(argparse.ArgumentParser):
    """An argument parser that raises InputError, so that a mistake is reported in one sentence."""

    def error(self, message: str) -> NoReturn:
        unknown = re.match("unrecognized arguments: .*?(--[^ =]+)", message)
        near = "" if unknown is None else meant(unknown[1], self._option_string_actions)
        raise InputError(message + (near or f"; see `{self.prog} --help`"))


def add_help_all(parser: argparse.ArgumentParser, usual: Collection[str]) -> None:
    """Have --help tell the usual switches alone, and declare --help-all, which tells all.

    Parameters
    ----------
    parser : ArgumentParser
        Its description is shortened to the first paragraph, and what follows the line ``methods:``.
    usual : collection of str
        Names of the values of the usual switches.
    """
    full = parser.description or ""
    helps = {action: action.help for action in parser._actions if action.option_strings}

    class HelpAll(argparse.Action):
        def __call__(self, *_: object) -> None:
            parser.description = full
            for action, text in helps.items():
                action.help = text
            parser.print_help()
            parser.exit()

    text = "tell all switches, and the format of handle files"
    parser.add_argument("--help-all", nargs=0, action=HelpAll, help=text)
    for action in helps:
        if action.dest not in {"help", *usual}:
            action.help = argparse.SUPPRESS
    first, _, rest = full.partition("\n\n")
    parser.description = f"{first}\n\nmethods:{rest.partition('methods:')[2]}"


def say(text: str) -> None:
    """Print a line on standard error."""
    print(text, file=sys.stderr)  # noqa: T201


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Draw progress on standard error if it is a terminal; see :func:`sshade.core.bars.stage_bars`."""
    if not sys.stderr.isatty():
        yield silent
        return
    from sshade.core.bars import stage_bars, stage_progress

    with stage_bars() as bars:
        yield stage_progress(bars)


@contextmanager
def announced_compilation() -> Iterator[None]:
    """Report compilation as :func:`compilation_told`, and print warnings as notes."""
    with warnings.catch_warnings(record=True) as found, compilation_told():
        yield
    for warning in found:
        say(f"note: {warning.message}")


@contextmanager
def compilation_told(tell: Callable[[str], None] | None = None) -> Iterator[None]:
    """Report when kernels are compiled, at their first use, and how long it took.

    `tell` gets the words at each compilation; by default they are printed on standard error, once.
    """
    from numba.core import event

    class CompilationTimer(event.TimingListener):
        """Measure the time of compilations in all threads; nested compilations count once."""

        announced = False

        def on_start(self, event: event.Event) -> None:
            if tell is not None or not self.announced:
                (tell or say)("compiling kernels of sshade once, for up to half a minute ...")
            self.announced = True
            super().on_start(event)

    listener = CompilationTimer()
    with event.install_listener("numba:compile", listener):
        yield
    if listener.done and tell is None:
        say(f"compiled in {listener.duration:.1f} s")


def missing_library(error: BaseException, extras: Mapping[str, str] | None = None) -> str | None:
    """Return what to install if a library of an extra is missing; None otherwise.

    Parameters
    ----------
    error : BaseException
    extras : mapping, optional
        Extras that bring further libraries than :data:`EXTRAS`, by the module that is imported.
    """
    library = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    extra = {**EXTRAS, **(extras or {})}.get(library)
    return f"{library} is not installed; {how_to_install(extra)}" if extra else None


def how_to_install(extra: str) -> str:
    """Return what to do if an extra of the package is not installed."""
    return f"install the extra {extra}, for example with pip install '.[{extra}]' in a clone"


@dataclass
class Ending:
    """How a command ended."""

    code: int = 0


@contextmanager
def mistakes_told(*, extras: Mapping[str, str] | None = None) -> Iterator[Ending]:
    """Report a mistake in a ``with`` block in one line on standard error, with exit code 2.

    Mistakes are an InputError; a FloatingPointError, when numbers fail on a mesh, for example with
    zero-area triangles; an OSError; a lack of memory; and a library that is not installed, if it is one of
    :data:`EXTRAS` or `extras`.
    If the reader of standard output has ended, as after ``| head``, the command ends silently. SIGINT and
    SIGTERM end it with exit code 130 and 143, and leave no temporary file.
    """
    end = Ending()
    with _ended_by_sigterm():
        try:
            yield end
            sys.stdout.flush()  # here, where a closed pipe is handled
            return
        except (InputError, FloatingPointError) as error:
            mistake = str(error)
        except BrokenPipeError:
            _drop_output()
            end.code = 141
            return
        except OSError as error:
            _drop_output()
            mistake = f"{error.filename}: {reason(error)}" if error.filename else reason(error)
        except MemoryError as error:
            mistake = f"there is not enough memory ({' '.join(str(error).split()) or 'out of memory'})"
        except ModuleNotFoundError as error:
            if (missing := missing_library(error, extras)) is None:
                raise
            mistake = missing
        except (KeyboardInterrupt, Ended, SystemError) as error:
            arrived = arrived_in(error)
            if isinstance(arrived, Ended):
                end.code = 128 + signal.SIGTERM
                return
            if not isinstance(arrived, KeyboardInterrupt):
                raise
            say("interrupted")
            end.code = 130
            return
    say(f"error: {mistake}")
    end.code = 2


def arrived_in(error: BaseException) -> BaseException:
    """Return the exception of a signal that arrived in a compiled function, or another error itself.

    The function raises SystemError from this exception, or from a further SystemError.
    """
    while isinstance(error, SystemError) and error.__cause__:
        error = error.__cause__
    return error


class Ended(SystemExit):
    """SIGTERM, which ends the program, where a plain SystemExit may come from the code of a method."""


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Have SIGTERM raise :class:`Ended` in a ``with`` block, so that temporary files are removed."""
    handled = signal.getsignal(signal.SIGTERM) == signal.SIG_DFL  # it may be ignored
    # Only the main thread may set handlers.
    if not handled or threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: object) -> None:
        signal.signal(number, signal.SIG_IGN)  # a second signal does not disturb the end
        raise Ended(128 + number)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _drop_output() -> None:
    """Discard pending output, which would fail again at the end of the interpreter."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def asked_help(arguments: Sequence[str]) -> Sequence[str]:
    """Read ``help [COMMAND]`` and ``--help COMMAND`` as ``[COMMAND] --help``; keep other arguments."""
    first, *rest = arguments or [""]
    return [*rest[:1], "--help"] if first in ("help", "-h", "--help") else arguments


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
    extras : mapping
        Extras that bring libraries of the program; see :func:`missing_library`.
    """

    name: str
    commands: Mapping[str, tuple[str, str]]
    text: str
    extras: Mapping[str, str] = {}

    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the command line; return the exit code."""
        name, *arguments = asked_help((sys.argv[1:] if argv is None else argv) or ["--help"])
        try:
            with mistakes_told(extras=self.extras) as end:
                tells = name in ("-h", "--help", "--version")
                end.code = self.tell(name) if tells else self.call(name, arguments)
            return end.code
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

    def call(self, name: str, arguments: Sequence[str]) -> int:
        """Run a sub-command; return the exit code.

        Raises
        ------
        InputError
            On a mistake in the arguments or in a named file.
        """
        if name not in self.commands:
            known = f"; use {self.name} {'|'.join(self.commands)}; see `{self.name} --help`"
            raise InputError(f"{name!r} is no command{meant(name, self.commands) or known}")
        module = import_module(self.commands[name][0])
        if not hasattr(module, "add_arguments"):  # a Hydra program
            return module.main(arguments)
        return module.command(self.parser(name).parse_args(arguments))

    def parser(self, name: str) -> argparse.ArgumentParser:
        """Return the parser of a sub-command; a Hydra program has none."""
        module = import_module(self.commands[name][0])
        parser = CommandParser(
            prog=f"{self.name} {name}",
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(parser)
        if hasattr(module, "USUAL"):
            add_help_all(parser, module.USUAL)
        return parser
