"""What freed arrays leave with the C library."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Give freed memory back to the system, in milliseconds, where the C library can do that: glibc's.

    Of arrays of some megabytes, made and freed in several threads, it keeps a fifth of what a polish needs.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
