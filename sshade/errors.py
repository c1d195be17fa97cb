"""The exception for mistakes in the input."""


class InputError(ValueError):
    """Input that cannot be used as it is.

    The message says what was found and what to do. The command line prints it without a traceback and exits
    with code 2.
    """
