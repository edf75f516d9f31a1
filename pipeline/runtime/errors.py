"""The error class for mistakes that a user can correct; all other errors are defects and keep their traceback."""


class InputError(ValueError):
    """An error that names the wrong value, what was expected and what to do; stages print it and exit with code 2."""
