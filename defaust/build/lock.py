"""Allow one build at a time in a folder."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from defaust.folder.layout import make_folder
from sshade import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger(__name__)

#: Lock file inside a folder under construction.
LOCK = ".lock"


@contextmanager
def sole_builder(out: Path) -> Iterator[None]:
    """Make a folder and lock it for this process.

    The operating system releases the lock when the process ends, so a killed build blocks no later one. A new
    folder that stays empty is removed.

    Raises
    ------
    InputError
        When another process builds there, or the folder cannot be created.
    """
    new = not out.exists()
    make_folder(out)
    file = _locked(out)
    try:
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}".encode())
        yield
    finally:
        if fcntl is None:
            file.close()  # Windows does not remove open files
        # Remove the file while it is locked: a process that opened it meanwhile sees that it is gone.
        (out / LOCK).unlink(missing_ok=True)
        file.close()
        if new:
            with suppress(OSError):  # not empty
                out.rmdir()


def _locked(out: Path) -> FileIO:
    """Open and lock the lock file of a folder."""
    path = out / LOCK
    while True:
        file = path.open("a+b", buffering=0)
        _lock(file, out)
        with suppress(FileNotFoundError):
            if os.path.samestat(path.stat(), os.fstat(file.fileno())):
                return file
        file.close()  # another process removed the file between opening and locking


def _lock(file: FileIO, out: Path) -> None:
    if fcntl is None:
        log.warning("%s: this system has no file locks; start no second build there", out)
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        file.seek(0)
        who = file.read().decode(errors="replace").strip() or "another process"
        file.close()
        raise InputError(f"{out}: {who} builds there; wait until it is done, or give another out") from error
    except OSError as error:  # a file system without locks, such as some network file systems
        log.warning("%s: cannot be locked (%s); start no second build there", out, error.strerror)
