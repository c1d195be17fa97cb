"""Allow one build at a time in a folder."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from sshade import InputError
from sshade.io.files import make_folder

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

    The operating system releases the lock when the process ends, so a killed build blocks no later one.

    Raises
    ------
    InputError
        When another process builds there, or the folder cannot be created.
    """
    make_folder(out)
    if fcntl is None:
        log.warning("%s: this system has no file locks; start no second build there", out)
        yield
        return
    path = out / LOCK
    with path.open("a+", encoding="utf-8") as file:
        _lock(file, out)
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}")
        file.flush()
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def _lock(file: IO[str], out: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        file.seek(0)
        who = file.read().strip() or "another process"
        raise InputError(f"{out}: {who} builds there; wait until it is done, or give another out") from error
    except OSError as error:  # a file system without locks, such as some network file systems
        log.warning("%s: cannot be locked (%s); start no second build there", out, error.strerror)
