"""Parallel jobs give what a loop gives, and an error in one ends all; tests/test_launch.py ends their parent."""

import pytest

from pipeline.runtime.parallel import map_jobs


def fail_on_two(job: int) -> int:
    if job == 2:
        raise ValueError("job 2 is bad")
    return job


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_error_in_a_job_reaches_the_caller(workers: int):
    with pytest.raises(ValueError, match="job 2 is bad"):
        map_jobs(fail_on_two, range(4), workers, "test")
    assert map_jobs(fail_on_two, [0, 1], workers, "test") == [0, 1]  # and the next call is none the worse
