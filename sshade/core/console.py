"""Helpers for all commands: arguments, progress bars, and exit codes on bad input."""

from __future__ import annotations

import argparse
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

from sshade.core.errors import InputError, reason
from sshade.core.progress import Progress, silent

if TYPE_CHECKING:
    from rich.progress import Progress as Bars


#: Extra that brings a library of this package, by the module that is imported.
EXTRAS = {"igl": "bench", **dict.fromkeys(("pyvista", "vtkmodules", "PIL"), "figures")}

#: Number of stages that are shown after their end, so that a screen has room for the stages that run.
ENDED = 5

#: Number of characters above which a message names no choices; the help lists them.
LONGEST_MESSAGE = 300


class CommandParser(argparse.ArgumentParser):
    """An argument parser that raises InputError, so that a mistake is reported in one sentence."""

    def error(self, message: str) -> NoReturn:
        if len(message) > LONGEST_MESSAGE:
            message = message.partition(" (choose from")[0]
        raise InputError(f"{message}; see `{self.prog} --help`")


def say(text: str) -> None:
    """Print a line on standard error."""
    print(text, file=sys.stderr)  # noqa: T201


@contextmanager
def progress_bar(*, remaining: str = "") -> Iterator[Progress]:
    """Draw progress on standard error if it is a terminal; see :func:`stage_bars`."""
    if not sys.stderr.isatty():
        yield silent
        return
    with stage_bars(remaining=remaining) as bars:
        yield stage_progress(bars)


def stage_bars(*, remaining: str = "", **options: Any) -> Bars:
    """Return progress bars of rich for standard error. They vanish at the end of a ``with`` block.

    Parameters
    ----------
    remaining : str
        Stage whose bar shows the estimated remaining time. Other stages have no estimate, because an
        iteration may converge at any time.
    **options
        Options of ``rich.progress.Progress``.
    """
    from rich import progress as rich
    from rich.console import Console
    from rich.text import Text

    class Remaining(rich.TimeRemainingColumn):
        def render(self, task: rich.Task) -> Text:
            return Text("left ") + super().render(task) if task.description == remaining else Text()

    columns = (
        *(rich.TextColumn("{task.description:<26}"), rich.BarColumn(), rich.MofNCompleteColumn()),
        *(rich.TimeElapsedColumn(), Remaining(), rich.TextColumn("{task.fields[note]}")),
    )
    # Print above the bars if standard output is the same terminal.
    redirect = sys.stdout.isatty()
    console = Console(stderr=True)
    return rich.Progress(*columns, console=console, redirect_stdout=redirect, transient=True, **options)


def stage_progress(bars: Bars) -> Progress:
    """Return a callback that draws one bar for each stage, and hides stages that ended long ago."""
    tasks: dict[str, Any] = {}
    ended: list[str] = []

    def progress(stage: str, done: int, total: int, note: str = "") -> None:
        if stage not in tasks:
            tasks[stage] = bars.add_task(stage, total=total, note=note)
        if stage in ended and done < total:  # another pass, such as a correction of the volume
            ended.remove(stage)
            bars.reset(tasks[stage], completed=done, total=total, note=note)
        bars.update(tasks[stage], completed=done, total=total, note=note, visible=True)
        if done >= total and stage not in ended:
            ended.append(stage)
            for earlier in ended[:-ENDED]:
                bars.update(tasks[earlier], visible=False)

    return progress


@contextmanager
def announced_compilation() -> Iterator[None]:
    """Report on standard error when kernels are compiled, at their first use, and how long it took."""
    from numba.core import event

    from sshade.core.kernels import why_compiled

    class CompilationTimer(event.TimingListener):
        """Measure the time of compilations in all threads; nested compilations count once."""

        announced = False

        def on_start(self, event: event.Event) -> None:
            if not self.announced:
                say(f"compiling kernels of sshade once, for up to half a minute: {why_compiled()} ...")
            self.announced = True
            super().on_start(event)

    listener = CompilationTimer()
    with event.install_listener("numba:compile", listener), warnings.catch_warnings(record=True) as found:
        yield
    if listener.done:
        say(f"compiled in {listener.duration:.1f} s" + ("" if found else "; later calls start at once"))
    for warning in found:
        say(f"note: {warning.message}")


def missing_library(error: BaseException, extras: Mapping[str, str] | None = None) -> str | None:
    """Return what to install if this package or a library of an extra is missing; None otherwise.

    Parameters
    ----------
    error : BaseException
    extras : mapping, optional
        Extras that bring further libraries than :data:`EXTRAS`, by the module that is imported.
    """
    if isinstance(error, ModuleNotFoundError) and error.name == "sshade":  # a clone asks for its version
        return "sshade is not installed; install it with pip install . in the clone"
    library = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    extra = {**EXTRAS, **(extras or {})}.get(library)
    return f"{library} is not installed; {how_to_install(extra)}" if extra else None


def how_to_install(extra: str) -> str:
    """Return what to do if an extra of the package is not installed."""
    return f"install the extra {extra}, for example with pip install '.[{extra}]' in a clone"


def run_command(main: Callable[[], int], *, extras: Mapping[str, str] | None = None) -> int:
    """Call `main`; report a mistake in one line on standard error and return exit code 2.

    Mistakes are an InputError; a FloatingPointError, when numbers fail on a mesh, for example with
    zero-area triangles; an OSError; a lack of memory; and a library that is not installed, if it is one of
    :data:`EXTRAS` or `extras`.
    If the reader of standard output has ended, as after ``| head``, the command ends silently. SIGINT and
    SIGTERM end it with exit code 130 and 143, and leave no temporary file.
    """
    _prepare_output()
    with _ended_by_sigterm():
        try:
            code = main()
            sys.stdout.flush()
            return code
        except (InputError, FloatingPointError) as error:
            mistake = str(error)
        except BrokenPipeError:
            _drop_output()
            return 141
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
                return 128 + signal.SIGTERM
            if not isinstance(arrived, KeyboardInterrupt):
                raise
            say("interrupted")
            return 130
    say(f"error: {mistake}")
    return 2


def _prepare_output() -> None:
    """Discard output where a stream was closed, and print letters outside of its encoding as escapes."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


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
