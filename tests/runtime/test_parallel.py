"""Parallel jobs give what a loop gives, an error in one ends all, and so does the end of their parent."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

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


SLEEPERS = """
import time
from pathlib import Path
import os, sys

from pipeline.runtime.parallel import map_jobs


def sleep(job):
    Path(sys.argv[1], str(os.getpid())).touch()
    time.sleep(600)


if __name__ == "__main__":
    map_jobs(sleep, [0, 1], 2, "sleepers")
"""


@pytest.mark.slow
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path):
    script, at_work = tmp_path / "sleepers.py", tmp_path / "at_work"
    script.write_text(SLEEPERS)
    at_work.mkdir()
    root = Path(__file__).resolve().parents[2]
    parent = subprocess.Popen([sys.executable, str(script), str(at_work)], env={**os.environ, "PYTHONPATH": str(root)})
    try:
        workers = _until(lambda: [int(p.name) for p in at_work.iterdir()], lambda found: len(found) == 2)
        assert len(workers) == 2
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    assert _until(lambda: [pid for pid in workers if _runs(pid)], lambda left: not left) == []


def _until(look, enough, seconds: float = 120):
    """What `look` finds once that is enough, or at the end."""
    end = time.monotonic() + seconds
    while not enough(found := look()) and time.monotonic() < end:
        time.sleep(0.1)
    return found


def _runs(pid: int) -> bool:
    """Whether the process is there and no zombie, which nobody may reap in a container."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
