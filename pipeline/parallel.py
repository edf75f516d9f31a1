"""Independent jobs over processes of one torch thread each."""

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

import torch
from tqdm import tqdm

Job = TypeVar("Job")
Result = TypeVar("Result")
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of glibc's mallopt


def map_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int, desc: str) -> list[Result]:
    """`[function(job) for job in jobs]` over `workers` fresh processes, with a progress bar.

    `function` and its jobs must pickle. Results come in the order of the jobs and, since every process has
    one torch thread, do not depend on `workers`. The first error ends the rest.
    """
    if workers == 1 or len(jobs) <= 1:
        _prepare()
        return [function(job) for job in tqdm(jobs, desc=desc)]
    with ProcessPoolExecutor(min(workers, len(jobs)), get_context("spawn"), initializer=_prepare) as pool:
        try:
            return list(tqdm(pool.map(function, jobs), total=len(jobs), desc=desc))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _prepare() -> None:
    """One torch thread, and freed activations kept: giving them back to the kernel costs a fifth of a step."""
    torch.set_num_threads(1)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # glibc only
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, 64 << 20)
        mallopt(M_TRIM_THRESHOLD, 512 << 20)
