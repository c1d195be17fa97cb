"""Allow one build at a time in a folder."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from defaust.folder.layout import make_folder
from sshade import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger(__name__)


@contextmanager
def sole_builder(out: Path) -> Iterator[None]:
    """Make a folder and lock it for this process. A new folder that stays empty is removed.

    The operating system releases the lock when the process ends, so a killed build blocks no later one.
    Windows and some network file systems have no such lock.

    Raises
    ------
    InputError
        When another process builds there, or the folder cannot be created.
    """
    new = not out.exists()
    make_folder(out)
    try:
        if fcntl is None:
            yield
            return
        folder = os.open(out, os.O_RDONLY)
        try:
            _lock(folder, out)
            yield
        finally:
            os.close(folder)
    finally:
        if new:
            with suppress(OSError):  # not empty
                out.rmdir()


def _lock(folder: int, out: Path) -> None:
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(
            f"{out}: another process builds there; wait until it is done, or give another out"
        ) from error
    except OSError as error:
        log.warning("%s: cannot be locked (%s); start no second build there", out, error.strerror)
