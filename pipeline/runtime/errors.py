"""The error that a user can correct; any other is a defect and keeps its traceback."""


class InputError(ValueError):
    """Says what came, what was expected and what to do; a stage ends with it in one line and exit code 2."""
