"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sshade.errors import InputError


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary name beside `path` to write to; rename it to `path` on success.

    On any error, an interrupt included, the temporary file is removed and what
    stood at `path` stays. The temporary name keeps the suffix, which many
    writers take the format from. What a process left there that was killed on
    this machine is removed too.

    Raises
    ------
    InputError
        When the file cannot be written: a full disk, a folder that is missing or
        not writable.
    """
    path = Path(path)
    mark = f"{_host()}-{os.getpid()}"
    temporary = path.with_name(f".{path.stem}.{mark}.partial{path.suffix}")
    _remove_leftovers(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written ({reason(error)})") from error
        raise


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", platform.node())[:40]


def _remove_leftovers(path: Path) -> None:
    """Remove temporary files for `path` of processes of this machine that are no more."""
    beginning, end = f".{path.stem}.{_host()}-", f".partial{path.suffix}"
    with suppress(OSError):
        for name in os.listdir(path.parent):
            if name.startswith(beginning) and name.endswith(end):
                pid = name[len(beginning) : -len(end)]
                if pid.isdecimal() and int(pid) != os.getpid() and not _alive(int(pid)):
                    (path.parent / name).unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it is another user's
        return True
    return True


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder and those above it, unless it is there.

    Raises
    ------
    InputError
        When that is not possible: a file in its way, a folder that is not writable, a full disk.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the folder cannot be made ({reason(error)})") from error


def check_output(path: str | os.PathLike[str], suffixes: Collection[str]) -> None:
    """Raise InputError if a file of one of these formats could not be written; call it before long work."""
    path = Path(path)
    check_suffix(path, suffixes)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} is not writable")


def check_suffix(path: Path, suffixes: Collection[str]) -> None:
    """Raise InputError unless the name ends with one of the suffixes, in any case."""
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: unknown format {path.suffix!r}; use {', '.join(suffixes)}")


def reason(error: OSError) -> str:
    """The text of an error of the system, such as "No space left on device", without number and path."""
    if error.strerror:
        return error.strerror
    # numpy's own: "12 requested and 0 written"
    return f"{' '.join(str(error).split()) or type(error).__name__}; the disk may be full"
