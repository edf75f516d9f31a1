"""Checks every annotated shape and type of the package while the tests run.

Hypothesis tries the same examples in every run; `--hypothesis-profile=default` draws new ones.
"""

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from pipeline.runtime.memory import disable_malloc_trim

install_import_hook("pipeline", "beartype.beartype")
disable_malloc_trim()  # as every stage's process does
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the smoke run first: it takes longest, and the other worker does the rest meanwhile (`make test`)."""
    items.sort(key=lambda item: item.path.name != "test_smoke.py")
