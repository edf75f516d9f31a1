"""The error class for mistakes that a user can correct, and how commands report it; all other errors are defects."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper


class InputError(ValueError):
    """An error that names the wrong value, what was expected and what to do."""


def replace_unprintable() -> None:
    """Print what the terminal's encoding lacks as `?`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def reported(*others: type[Exception]) -> Iterator[None]:
    """End the process with one line and exit code 2 at an InputError, or at one of `others`."""
    replace_unprintable()
    try:
        yield
    except (InputError, *others) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
