"""Independent jobs over processes of one torch thread each."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, pthread_sigmask
from threading import Thread
from typing import TypeVar

import torch
from tqdm import tqdm

from pipeline.runtime.memory import disable_malloc_trim

Job = TypeVar("Job")
Result = TypeVar("Result")


def map_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int, desc: str) -> list[Result]:
    """`[function(job) for job in jobs]` over `workers` processes, with a progress bar.

    `function` and its jobs must pickle. Results come in the order of the jobs and, since every process has
    one torch thread, do not depend on `workers`. The first error ends the rest. The processes wait for the next call.
    """
    if workers == 1 or len(jobs) <= 1:
        one_thread()
        return [function(job) for job in tqdm(jobs, desc=desc)]
    pool = _pool(workers)
    try:
        with _uninterrupted():
            results = pool.map(function, jobs)
        return list(tqdm(results, total=len(jobs), desc=desc))
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in active_children():  # at once, whatever they are at
            process.terminate()
        _pool.cache_clear()
        raise


@lru_cache(maxsize=1)
def _pool(workers: int) -> ProcessPoolExecutor:
    """Processes of their own, for all calls: importing torch anew takes each some three seconds."""
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=_begin)


def one_thread() -> None:
    """What this process needs to do jobs: one torch thread, on which no result may depend, and the memory it freed."""
    torch.set_num_threads(1)
    disable_malloc_trim()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until the end; processes begun within never hear it: to answer it is this one's."""
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)


def _begin() -> None:
    """In each new process."""
    one_thread()
    if parent := parent_process():
        Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    """End this process when its parent has ended, even if killed: nobody waits for its results any more."""
    parent.join()
    os._exit(1)
