"""Run commands in this process, and assert that they are refused in one sentence."""

import contextlib
import importlib
import io
import os
import resource
import shlex
import signal
from collections.abc import Iterable, Iterator
from unittest import mock

import yaml

from tests.files import contents

#: Beginnings of the lines that the first call on a machine prints, because it compiles kernels.
ANNOUNCEMENTS = ("compiling kernels", "compiled in")

#: Maximum length of an error message, in characters.
LONGEST = 420


def assert_refused(program: str, arguments: str | Iterable[str], *words: str) -> None:
    """Assert that a command fails with one sentence that has these words, and changes no file."""
    line = arguments if isinstance(arguments, str) else shlex.join(map(str, arguments))
    before = contents()
    check_refusal(run(f"{program} {line}"), *words)
    assert contents() == before


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
        # The command sets environment variables for its child processes, such as PYTHONSAFEPATH. Hydra reads
        # a hundred files for each run, in a third of the time with the parser in C.
        fast = mock.patch.object(yaml, "SafeLoader", getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        with mock.patch.dict(os.environ), fast:
            return main(arguments)
    name = {"sshade": "sshade.cli.main", "defaust": "defaust.cli"}[program]
    return importlib.import_module(name).main(arguments)


@contextlib.contextmanager
def full_disk(size: int) -> Iterator[None]:
    """Keep files from growing beyond `size` bytes for a while, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
