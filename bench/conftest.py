"""What every benchmark shares."""

import pytest
import torch

from pipeline.parallel import map_jobs


@pytest.fixture(autouse=True)
def one_thread():
    """One torch thread and the workers' allocator settings, as in the stages."""
    threads = torch.get_num_threads()
    map_jobs(abs, [0], workers=1, desc="settings")
    yield
    torch.set_num_threads(threads)
