"""Run independent jobs in processes with one torch thread each (joblib)."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, pthread_sigmask
from threading import Thread
from typing import TypeVar

import cv2
import torch
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.backend import resource_tracker
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from pipeline.runtime.instructions import disable_malloc_trim

Job = TypeVar("Job")
Result = TypeVar("Result")


def map_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int, desc: str) -> list[Result]:
    """Return `[function(job) for job in jobs]`, computed in `workers` processes, with a progress bar.

    `function` and its jobs must pickle. Results are in the order of the jobs and do not depend on `workers`, since
    every process has one torch thread. The first error cancels the remaining jobs. Processes are kept for the next
    call.
    """
    if workers == 1 or len(jobs) <= 1:
        one_thread()
        return [function(job) for job in tqdm(jobs, desc=desc)]
    call = delayed(_in_worker)
    results = None
    try:
        # max_nbytes: no read-only memory maps; pre_dispatch: all processes start within _uninterrupted
        with _uninterrupted(), parallel_config("loky", inner_max_num_threads=1):
            pool = Parallel(workers, return_as="generator", batch_size=1, max_nbytes=None, pre_dispatch="all")
            results = pool(call(function, job, os.getpid()) for job in jobs)
        return list(tqdm(results, total=len(jobs), desc=desc))
    finally:
        if results is not None:
            results.close()  # stops the processes if jobs are left


def one_thread() -> None:
    """Limit this process to one thread in torch, BLAS and OpenCV, since the order of sums changes rounding."""
    torch.set_num_threads(1)
    threadpool_limits(1)
    cv2.setNumThreads(1)
    disable_malloc_trim()


def _in_worker(function: Callable[[Job], Result], job: Job, parent: int) -> Result:
    _begin(parent)
    return function(job)


@cache
def _begin(parent: int) -> None:
    """Set up a worker process, once."""
    one_thread()
    Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process after its parent ends, even if that was killed."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Block Ctrl-C in this block; processes started within never receive it, so that only this process handles it."""
    resource_tracker.ensure_running()  # loky would otherwise start it in this block and unblock Ctrl-C
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)
