"""The one exception that stands for a mistake in the input rather than in the program."""


class InputError(ValueError):
    """Input that cannot be used as it is.

    The message is one sentence that says what was found and what would work;
    the command line prints it alone and exits with code 2.
    """
