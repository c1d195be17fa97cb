"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from sshade.errors import InputError

#: Numbers the writes of this process, so that two threads never share a temporary name.
_WRITES = count()


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; rename it to `path` on success.

    On any error, interrupts included, the temporary file is removed and an existing file at `path`
    stays. The temporary name keeps the suffix, from which many writers take the format. It is unique
    to this call: of several writers of one path, the last to finish wins. Temporary files that killed
    processes of this machine left for `path` are removed as well.

    Raises
    ------
    InputError
        When the file cannot be written: the disk is full, or the folder is missing or read-only.
    """
    path = Path(path)
    _remove_leftovers(path)
    beginning, end = _temporary_affixes(path)
    temporary = path.with_name(f"{beginning}{os.getpid()}-{next(_WRITES)}{end}")
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written ({reason(error)})") from error
        raise


def _temporary_affixes(path: Path) -> tuple[str, str]:
    """Return the prefix and the suffix of the temporary names for a path on this machine."""
    host = re.sub(r"[^A-Za-z0-9]", "_", platform.node())[:40]
    return f".{path.stem}.{host}-", f".partial{path.suffix}"


def _remove_leftovers(path: Path) -> None:
    """Remove temporary files for `path` that belong to processes of this machine that have ended."""
    import psutil  # here, so that `import sshade` does not load it

    beginning, end = _temporary_affixes(path)
    with suppress(OSError):
        for name in os.listdir(path.parent):
            if name.startswith(beginning) and name.endswith(end):
                process, _, _ = name[len(beginning) : -len(end)].partition("-")
                if process.isdecimal() and not psutil.pid_exists(int(process)):
                    (path.parent / name).unlink(missing_ok=True)


@contextmanager
def naming(place: object) -> Iterator[None]:
    """Prefix messages of InputErrors with a place, such as the file that is being read."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


def make_folder(path: str | os.PathLike[str]) -> None:
    """Create a folder and its parents unless they exist.

    Raises
    ------
    InputError
        When the folder cannot be created: a file is in its way, a parent is read-only, the disk is full.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the folder cannot be created ({reason(error)})") from error


def check_output(path: str | os.PathLike[str], suffixes: Collection[str]) -> None:
    """Raise InputError unless `path` has one of the suffixes and lies in a writable folder.

    Commands call this before long computations.
    """
    path = Path(path)
    check_suffix(path, suffixes)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} is not writable")


def check_suffix(path: Path, suffixes: Collection[str]) -> None:
    """Raise InputError unless `path` ends with one of the suffixes; case does not matter."""
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: unknown format {path.suffix!r}; use {', '.join(suffixes)}")


def reason(error: OSError) -> str:
    """Return the text of a system error, such as "No space left on device", without number and path."""
    if error.strerror:
        return error.strerror
    # NumPy raises OSError with a text alone: "12 requested and 0 written".
    return f"{' '.join(str(error).split()) or type(error).__name__}; the disk may be full"
