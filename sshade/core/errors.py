"""The exception for mistakes in the input, and the words of its messages."""


class InputError(ValueError):
    """Input that cannot be used as it is.

    The message says what was found and what to do. The command line prints it without a traceback and exits
    with code 2.
    """


def counted(number: int, one: str, several: str) -> str:
    """Return a number with a word: ``1 proxy``, ``2 proxies``."""
    return f"{number} {one if number == 1 else several}"


def reason(error: OSError) -> str:
    """Return the text of a system error, such as "No space left on device", without number and path."""
    if error.strerror:
        return error.strerror
    # NumPy raises OSError with a text alone: "12 requested and 0 written".
    return f"{' '.join(str(error).split()) or type(error).__name__}; the disk may be full"
