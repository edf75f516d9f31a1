"""Every annotated shape and type of the package is checked while the tests run."""

import pytest
from jaxtyping import install_import_hook

install_import_hook("pipeline", "beartype.beartype")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The smoke run first: files are dealt out in this order, and it takes longest."""
    items.sort(key=lambda item: item.path.name != "test_smoke.py")
