"""Processes that multiprocessing begins."""

from __future__ import annotations

import multiprocessing
import os
from threading import Thread


def end_with_parent() -> None:
    """From now on end this process, at once, when the process that began it ends.

    A parent that is killed cannot tell its children, which would work on for nobody.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()
