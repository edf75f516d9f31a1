"""Fixtures shared by all benchmarks."""

import pytest

from pipeline.runtime import parallel


@pytest.fixture(autouse=True, scope="session")
def one_thread():
    """Use one torch thread and the workers' allocator settings, as in the stages."""
    parallel.one_thread()
