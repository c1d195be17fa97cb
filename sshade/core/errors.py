"""The exception for mistakes in the input, and the words of its messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class InputError(ValueError):
    """Input that cannot be used as it is.

    The message names the mistake and the remedy. The command line prints it without a traceback and exits
    with code 2.
    """


def counted(number: int, one: str, several: str) -> str:
    """Return a number with a word: ``1 proxy``, ``2 proxies``."""
    return f"{number} {one if number == 1 else several}"


def meant(word: object, known: Iterable[str]) -> str:
    """Return a question about the known word that is nearest to an unknown one; "" if none is near."""
    names = {name.lower(): name for name in known}
    near = get_close_matches(str(word).lower(), names, n=1)
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def reason(error: OSError) -> str:
    """Return the text of a system error, such as "No space left on device", without number and path."""
    if error.strerror:
        return error.strerror
    # NumPy raises OSError with a text alone: "12 requested and 0 written".
    return f"{' '.join(str(error).split()) or type(error).__name__}; the disk may be full"
