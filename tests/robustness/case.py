"""Define the cases of the catalogue and try them."""

import contextlib
import importlib
import io
import os
import resource
import shlex
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from tests.files import contents

#: Beginnings of the lines that the first call on a machine prints, because it compiles kernels.
ANNOUNCEMENTS = ("compiling kernels", "compiled in")

#: Maximum length of an error message, in characters.
LONGEST = 420


def nothing() -> None:
    """Leave the folder as it is: a sound mesh and pose."""


@dataclass(frozen=True)
class Case:
    """One input and the expected outcome.

    Parameters
    ----------
    name : str
        Unique in the catalogue.
    call : str or callable
        A command line, such as ``sshade deform body.ply pose.json -o out.ply``
        or ``sshade-eval tables rows.csv``; or a function without arguments that makes its own assertions.
    given : callable
        Writes the input into the working folder, which already has a sound ``body.ply``
        and ``pose.json``.
    says : tuple of str
        Words that the error message contains. The command refuses the input in one sentence, with exit
        code 2. Empty if the command accepts the input.
    leaves : tuple of str
        Files that the case may make or change, and that exist afterwards. A folder stands for all files
        in it.
    holds : callable, optional
        Asserts that the files are as promised.
    code : int
        Exit code if the command accepts the input.
    """

    name: str
    call: str | Callable[[], Any]
    given: Callable[[], None] = nothing
    says: tuple[str, ...] = ()
    leaves: tuple[str, ...] = ()
    holds: Callable[..., None] | None = None
    code: int = 0


def refused(call: str, table: Mapping[str, tuple[Any, ...]], *, prefix: str = "") -> list[Case]:
    """Return the cases of a table, which maps a name to the writer of an input and the expected words."""
    return [Case(prefix + name, call, given, says=tuple(says)) for name, (given, *says) in table.items()]


def attempt(case: Case) -> None:
    """Try a case in the working folder; raise AssertionError if the outcome is not the expected one."""
    case.given()
    before = contents()
    if isinstance(case.call, str):
        code, out, err = run(case.call)
        if case.says:
            check_refusal((code, out, err), *case.says)
        else:
            assert code == case.code, f"exit code {code}: {out} {err}"
            if case.holds:
                case.holds()
    else:
        case.call()
    made = {path for path, data in contents().items() if before.get(path) != data}
    lost = sorted(before.keys() - contents().keys())
    assert not lost, f"lost: {lost}"
    stray = {p for p in made if not any(name in (".", p) or p.startswith(f"{name}/") for name in case.leaves)}
    assert not stray, f"left behind: {sorted(stray)}"
    missing = [name for name in case.leaves if not Path(name).exists()]
    assert not missing, f"not made: {missing}"


def assert_refused(program: str, arguments: Iterable[str], *words: str) -> None:
    """Assert that a command fails with one sentence that has these words, and changes no file."""
    call = shlex.join([program, *map(str, arguments)])
    attempt(Case(call, call, says=words))


def check_refusal(ended: tuple[int, str, str], *words: str) -> None:
    """Assert that a run ended with exit code 2 and printed only one sentence, which has these words."""
    code, out, err = ended
    assert (code, out) == (2, ""), f"exit code {code}: {out} {err}"
    assert err.startswith("error: ") and err.endswith("\n"), err
    text = err[len("error: ") : -1]
    assert "\n" not in text and len(text) <= LONGEST and "Traceback" not in text, text
    for word in words:
        assert word in text, f"{word!r} is not in: {text}"


def run(command: str) -> tuple[int, str, str]:
    """Run a command line in this process; return its exit code, standard output and standard error."""
    program, *arguments = shlex.split(command)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = _main(program, arguments)
        except SystemExit as left:
            code = left.code
    lines = [line for line in err.getvalue().splitlines(keepends=True) if not line.startswith(ANNOUNCEMENTS)]
    return code, out.getvalue(), "".join(lines)


def _main(program: str, arguments: list[str]) -> int:
    if program == "sshade-eval":
        from eval.main import main
        from eval.run import config, sweep

        for kept in (config._loaded, sweep._cases):  # the folders of several cases have the same name
            kept.cache_clear()
        # The command sets environment variables for its child processes, such as PYTHONSAFEPATH.
        with mock.patch.object(sys, "argv", list(sys.argv)), mock.patch.dict(os.environ):
            return main(arguments)
    name = {"sshade": "sshade.cli.main", "defaust": "defaust.cli"}[program]
    return importlib.import_module(name).main(arguments)


@contextlib.contextmanager
def limited(size: int) -> Iterator[None]:
    """Keep files from growing beyond `size` bytes for a while, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)


def on_a_full_disk(call: str, given: Callable[[], None] = nothing) -> Case:
    """Return a case in which a command works, then fails on a full disk and changes no file."""

    def attempt() -> None:
        code, _, err = run(call)
        assert code == 0, err  # first with room, so that the machine code of kernels is stored
        before = contents()
        with limited(60):
            check_refusal(run(call), "cannot be written (File too large)")
        assert contents() == before

    return Case(f"full disk: {call}", attempt, given, leaves=(".",))
