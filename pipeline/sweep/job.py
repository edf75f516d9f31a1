"""One job of a sweep: run the stages in a clone of the commit, and keep what tells its result in a folder.

The folder holds `job.json` (overrides, commit, state, seconds), `params.yaml`, `dvc.lock`, `metrics.json`,
`results.parquet` (headline, seed, value) and `log.txt`.
"""

import hashlib
import math
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from configobj import ConfigObj

from pipeline.artifacts.files import read_json, read_table, write_json, write_table
from pipeline.artifacts.headlines import headlines
from pipeline.git import environment, git, make_clone
from pipeline.launch import load
from pipeline.runtime.errors import InputError

WATCH_S = 0.5  # between two looks at the parent process
MAX_NAME = 120  # characters of a folder's name; longer ones end in a digest
LEFT_OUT = ("store", "examples", "tests", "bench")  # folders that no stage reads


@dataclass(frozen=True)
class Sweep:
    """Hold what all jobs of a sweep share; paths are absolute and mean the same on every machine that runs jobs."""

    root: Path  # the repository
    folder: Path  # of the sweep
    cache: Path  # DVC's
    record: dict[str, Any]  # sweep.json: commit, targets, objective, fixed, ...
    process: int = 0  # the sweep's own, the parent of joblib's processes

    def job_folder(self, overrides: Sequence[str]) -> Path:
        """Return the folder of a job, named by its overrides, but for those that all jobs share."""
        name = ",".join(sorted({*overrides} - {*self.record["fixed"]})).replace("/", "_") or "default"
        if len(name) > MAX_NAME:
            name = f"{name[:MAX_NAME]}~{hashlib.sha256(name.encode()).hexdigest()[:8]}"
        return self.folder / "jobs" / name


def run_job(sweep: Sweep, overrides: Sequence[str]) -> float:
    """Run one job unless it is done, and return its objective, NaN if it fails or the sweep has none.

    A failure is written into its `job.json` and raises nothing, so that it takes no other job along.
    """
    folder, objective, targets = sweep.job_folder(overrides), sweep.record["objective"], sweep.record["targets"]
    if not is_done(folder):
        folder.mkdir(parents=True, exist_ok=True)
        record = {"overrides": list(overrides), "commit": sweep.record["commit"], "state": "running"}
        start = time.time()
        write_json(folder / "job.json", record)
        clone = sweep.folder / "clones" / f"{socket.gethostname()}-{os.getpid()}"
        try:
            _prepare(sweep, clone)
            _run_stages(sweep, overrides, clone, folder)
            for name in ("params.yaml", "dvc.lock"):
                shutil.copy(clone / name, folder)
            metrics = {name: clone / "outputs" / name / "metrics.json" for name in targets}
            write_json(folder / "metrics.json", {n: read_json(path) for n, path in metrics.items() if path.is_file()})
            results = headlines(load(clone / "params.yaml"), clone, targets)
            write_table(folder / "results.parquet", results)
            _mean(results, objective)  # a misspelt objective fails the job
            record["state"] = "done"
        except (InputError, OSError) as error:
            shutil.rmtree(clone, ignore_errors=True)
            record |= {"state": "failed", "error": " ".join(str(error).split())}
        write_json(folder / "job.json", record | {"seconds": round(time.time() - start, 1)})
        print(f"{record['state']} in {time.time() - start:.0f} s: {folder.name}", flush=True)
    return _mean(read_table(folder / "results.parquet"), objective) if is_done(folder) else math.nan


def is_done(folder: Path) -> bool:
    """Return whether a job's folder holds a complete result."""
    return (folder / "job.json").is_file() and read_json(folder / "job.json")["state"] == "done"


def snapshot(root: Path) -> str:
    """Return the commit to run: HEAD, or one on no branch with the uncommitted changes of files that git knows.

    Git works on a copy of the index, for `git commit -a` locks the person's while its hooks run.
    """
    author = ("-c", "user.name=sweep", "-c", "user.email=sweep@localhost")
    with TemporaryDirectory() as folder:
        index = shutil.copy(root / git(root, "rev-parse", "--git-path", "index").strip(), folder)
        created = git(root, *author, "stash", "create", env={"GIT_INDEX_FILE": index})
    return created.strip() or git(root, "rev-parse", "HEAD").strip()


def _prepare(sweep: Sweep, clone: Path) -> None:
    """Make this process's clone of the sweep's commit, or clean the one that its job before left.

    A process keeps its clone, because each new one compiles the fast kernels and hashes the data.
    """
    if not (clone / ".dvc" / "config.local").is_file():
        clone.parent.mkdir(parents=True, exist_ok=True)
        make_clone(sweep.root, sweep.record["commit"], clone, LEFT_OUT)
        config = ConfigObj(f"{sweep.root}/.dvc/config.local", encoding="utf-8")  # the person's, such as cache.shared
        cache = {"dir": str(sweep.cache), "type": "reflink,hardlink,copy"}
        core, store = {"site_cache_dir": f"{clone}/.dvc/tmp/site"}, {"url": f"{sweep.root}/store"}
        config.merge({"core": core, "cache": cache, 'remote "store"': store})
        config.filename = f"{clone}/.dvc/config.local"
        config.write()
    git(clone, "reset", "--quiet", "--hard")  # parameters, graph and locks of the job before


def _run_stages(sweep: Sweep, overrides: Sequence[str], clone: Path, folder: Path) -> None:
    """Run the stages in a process group of their own; raise InputError with the last line of the log if they fail.

    They end with this process. If this is a child of the sweep's process, as joblib's are, it ends with that.
    """
    env = {"PYTHONHASHSEED": "0", "PYTHONUNBUFFERED": "1", "TQDM_DISABLE": "1", "PYTHONPATH": str(clone)}
    env["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # stages are run as `python -m ...`
    command = ["-m", "pipeline.sweep.stages", *sweep.record["targets"], "--overrides", "workers=1", *overrides]
    place: dict[str, Any] = {"cwd": clone, "env": environment(env), "start_new_session": True}
    is_child = os.getppid() == sweep.process
    with (folder / "log.txt").open("w", encoding="utf-8") as log:
        process = subprocess.Popen([sys.executable, *command], stdout=log, stderr=log, **place)
        while process.poll() is None:
            time.sleep(WATCH_S)
            if is_child and os.getppid() != sweep.process:
                os._exit(1)
    if process.returncode:
        lines = ["no output", *(folder / "log.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()]
        stated = [line for line in lines if line.startswith("error: ")]
        raise InputError((stated or lines)[-1].removeprefix("error: "))


def _mean(results: pd.DataFrame, headline: str | None) -> float:
    """Return the mean over seeds of a headline, NaN for None; raise InputError if there is no such headline."""
    values = results.loc[results["headline"] == headline, "value"]
    if headline is not None and values.empty:
        raise InputError(f"objective {headline!r}: expected one of {', '.join(results['headline'].unique())}")
    return float(values.mean())
