"""Return freed memory to the operating system."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Return the memory that the C library keeps after arrays are freed, where it is glibc.

    After arrays of some megabytes in several threads, glibc keeps about a fifth of the memory of a polish.
    The call takes milliseconds.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
