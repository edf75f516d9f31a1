"""Every annotated shape and type of the package is checked while the tests run.

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
    """The smoke run comes first: it takes longest, and beside it goes all the rest (`make test`)."""
    items.sort(key=lambda item: item.path.name != "test_smoke.py")
