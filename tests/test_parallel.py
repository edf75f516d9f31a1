"""Parallel jobs give what a loop gives, and an error in one ends all."""

import os

import numpy as np
import pytest
import torch

from pipeline.parallel import map_jobs


def noisy_sum(seed: int) -> float:
    assert torch.get_num_threads() == 1
    generator = torch.Generator().manual_seed(seed)
    return float(torch.randn(1000, generator=generator).sum())


def process(_: int) -> int:
    return os.getpid()


def fail_on_two(job: int) -> int:
    if job == 2:
        raise ValueError("job 2 is bad")
    return job


def test_results_do_not_depend_on_the_number_of_workers():
    one, two = (map_jobs(noisy_sum, range(5), workers, "test") for workers in (1, 2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_job_reaches_the_caller(workers: int):
    with pytest.raises(ValueError, match="job 2 is bad"):
        map_jobs(fail_on_two, range(4), workers, "test")
    assert map_jobs(fail_on_two, [0, 1], workers, "test") == [0, 1]  # and the next call is none the worse


def test_the_next_call_meets_the_same_processes():
    first, second = (set(map_jobs(process, range(8), 2, "test")) for _ in range(2))
    assert os.getpid() not in first
    assert len(first | second) <= 2
