"""Checks every annotated shape and type of the package while the tests run.

Hypothesis tries the same examples in every run; `--hypothesis-profile=default` draws new ones.
"""

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

install_import_hook("pipeline", "beartype.beartype")
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the smoke run first: it takes longest, and the other worker does the rest meanwhile (`make test`)."""
    items.sort(key=lambda item: item.path.name != "test_smoke.py")


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """As in every stage's process; two threads that wait for each other on a busy machine take minutes for seconds."""
    from pipeline.runtime.parallel import one_thread

    one_thread()
