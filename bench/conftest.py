"""Fixtures shared by all benchmarks."""

import pytest
import torch

from pipeline.runtime import parallel


@pytest.fixture(autouse=True)
def one_thread():
    """Use one torch thread and the workers' allocator settings, as in the stages."""
    threads = torch.get_num_threads()
    parallel.one_thread()
    yield
    torch.set_num_threads(threads)
