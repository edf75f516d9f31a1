"""One job of a sweep: run the stages in a clone, and keep what tells its result in a folder named by its overrides.

The folder holds `job.json` (overrides, commit, state, stages run or restored, seconds), `params.yaml`, `dvc.lock`,
`metrics.json`, `results.parquet` (headline, seed, value) and `log.txt`.
"""

import hashlib
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.artifacts.files import read_json, read_table, write_json, write_table
from pipeline.audit.setting import setting
from pipeline.git import environment
from pipeline.launch import load
from pipeline.runtime.errors import InputError
from pipeline.sweep.clone import borrowed_clone
from pipeline.sweep.results import headlines

WATCH_S = 0.5  # between two looks at the parent process
MAX_NAME = 120  # characters of a folder's name; longer ones end in a digest
FULL = ("No space left on device", "Out of diskspace")  # what the system and git say of a full disk


@dataclass(frozen=True)
class Sweep:
    """Hold what all jobs of a sweep share; paths are absolute and mean the same on every machine that runs jobs."""

    root: Path  # the repository
    folder: Path  # of the sweep
    cache: Path  # DVC's
    commit: str
    targets: tuple[str, ...]  # stages that jobs run up to
    fixed: tuple[str, ...] = ()  # overrides of every job, which its folder's name leaves out
    objective: str | None = None  # the headline whose mean a job returns to Hydra's sweeper
    process: int = 0  # the sweep's own, the parent of joblib's processes

    def job_folder(self, overrides: Sequence[str]) -> Path:
        """Return the folder of a job, the same for every spelling of its setting."""
        name = ",".join(setting(overrides, self.fixed)).replace("/", "_") or "default"
        if len(name) > MAX_NAME:
            name = f"{name[:MAX_NAME]}~{hashlib.sha256(name.encode()).hexdigest()[:8]}"
        return self.folder / "jobs" / name


def run_job(sweep: Sweep, overrides: Sequence[str]) -> float:
    """Run one job unless it is done, and return its objective, NaN if it fails or the sweep has none.

    A failure is written into its `job.json` and raises nothing, so that it takes no other job along.
    """
    folder = sweep.job_folder(overrides)
    if not is_done(folder):
        folder.mkdir(parents=True, exist_ok=True)
        record = {"overrides": list(overrides), "commit": sweep.commit, "targets": list(sweep.targets)}
        start = time.time()
        write_json(folder / "job.json", record | {"state": "running"})
        record["state"] = "interrupted"  # unless it ends
        try:
            with borrowed_clone(sweep.root, sweep.commit, sweep.cache, sweep.folder / "clones") as clone:
                stages = _run_stages(sweep, overrides, clone, folder)
                for name in ("params.yaml", "dvc.lock"):
                    shutil.copy(clone / name, folder)
                metrics = {name: clone / "outputs" / name / "metrics.json" for name in sweep.targets}
                measured = {name: read_json(path) for name, path in metrics.items() if path.is_file()}
                write_json(folder / "metrics.json", measured)
                results = headlines(load(clone / "params.yaml"), clone, sweep.targets)
                write_table(folder / "results.parquet", results)
            _mean(results, sweep.objective)  # a misspelt objective fails the job
            record |= {"state": "done", "stages": stages}
        except (InputError, OSError) as error:
            record |= {"state": "failed", "error": reason(error, sweep.folder)}
        finally:
            write_json(folder / "job.json", record | {"seconds": round(time.time() - start, 1)})
    return _mean(read_table(folder / "results.parquet"), sweep.objective) if is_done(folder) else math.nan


def reason(error: Exception, folder: Path) -> str:
    """Return why a job failed, in one line; `folder` is the sweep's."""
    text = " ".join(str(error).split())
    full = any(words in text for words in FULL)
    return f"the disk of {folder} is full: make room, then --resume it ({text})" if full else text


def is_done(folder: Path) -> bool:
    """Return whether a job's folder holds a complete result."""
    return (folder / "job.json").is_file() and read_json(folder / "job.json")["state"] == "done"


def _run_stages(sweep: Sweep, overrides: Sequence[str], clone: Path, folder: Path) -> dict:
    """Run the stages in a process group of their own; raise InputError with the last line of the log if they fail."""
    command = [sys.executable, "-m", "pipeline.sweep.stages", *sweep.targets, "--overrides", "workers=1", *overrides]
    env = environment({"PYTHONHASHSEED": "0", "TQDM_DISABLE": "1", "PYTHONPATH": str(clone)})
    env["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{env['PATH']}"  # stages are run as `python -m ...`
    with (folder / "log.txt").open("w") as log:
        process = subprocess.Popen(command, cwd=clone, env=env, stdout=log, stderr=log, start_new_session=True)
        try:
            status = _wait(process, sweep.process)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    if status:
        lines = [line.strip() for line in (folder / "log.txt").read_text(errors="replace").splitlines() if line.strip()]
        stated = [line for line in lines if line.startswith("error: ")]
        raise InputError((stated or lines or ["no output"])[-1].removeprefix("error: "))
    return read_json(clone / "stages.json")


def _wait(process: subprocess.Popen, parent: int) -> int:
    """Return the exit status of `process`; end this process if it was a child of `parent` and that was killed.

    joblib's processes would otherwise go on. The stages end with this process.
    """
    child = os.getppid() == parent
    while True:
        try:
            return process.wait(WATCH_S)
        except subprocess.TimeoutExpired:
            if child and os.getppid() != parent:
                os._exit(1)


def _mean(results: pd.DataFrame, headline: str | None) -> float:
    """Return the mean over seeds of a headline, NaN for None; raise InputError if there is no such headline."""
    values = results.loc[results["headline"] == headline, "value"]
    if headline is not None and values.empty:
        raise InputError(f"objective {headline!r}: expected one of {', '.join(results['headline'].unique())}")
    return float(values.mean())
