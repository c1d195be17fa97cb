"""One build at a time in a folder."""

from __future__ import annotations

import errno
import logging
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from sshade import InputError
from sshade.io.files import make_folder

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger(__name__)

#: Inside a folder under construction.
LOCK = ".lock"


@contextmanager
def sole_builder(out: Path) -> Iterator[None]:
    """Make a folder and be the only one that builds in it.

    The system drops the lock with the process, so that a killed build leaves
    none; its file is taken over. A folder that was made for it and stays empty
    is removed.

    Raises
    ------
    InputError
        When another process builds there, or the folder cannot be made.
    """
    new = not out.exists()
    make_folder(out)
    path = out / LOCK
    file = _locked(path)
    try:
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}")
        file.flush()
        yield
    finally:
        if fcntl is None:
            file.close()  # such systems keep files that are open
        # Others that wait see that it is gone, and begin with a file of their own.
        path.unlink(missing_ok=True)
        file.close()
        if new:
            with suppress(OSError):
                out.rmdir()


def _locked(path: Path) -> IO[str]:
    while True:
        file = path.open("a+", encoding="utf-8")
        if fcntl is None:
            log.warning("%s: this system has no such locks; start no second build there", path)
            return file
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                # A file system without locks: better unguarded than not at all.
                log.warning("%s: no lock can be had (%s); start no second build there", path, error.strerror)
                return file
            file.seek(0)
            who = file.read().strip() or "another process"
            file.close()
            raise InputError(
                f"{path.parent}: {who} builds there; wait until it is done, or give another out"
            ) from error
        with suppress(FileNotFoundError):
            if os.stat(path).st_ino == os.fstat(file.fileno()).st_ino:
                return file
        file.close()  # it was removed between opening and locking
