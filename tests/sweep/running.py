"""Run sweeps as a user does, in a clone of the working tree that has a cache of its own."""

import json
import subprocess
import sys
from pathlib import Path

from pipeline.git import environment as without_repository
from pipeline.git import make_clone, run
from pipeline.runtime.places import ROOT
from pipeline.sweep.job import snapshot

LEFT_OUT = [f"~variants.{name}" for name in ("full", "ae", "classifier", "irl_maxent", "irl_ranked")]
SMALL = ["profile=smoke", *LEFT_OUT, "clearance.steps=4", "n_demos=[9]"]  # the quickest graph up to evaluate


def clone_of_working_tree(clone: Path) -> Path:
    return make_clone(ROOT, snapshot(ROOT), clone)


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "pipeline.sweep", *arguments]


def environment(repository: Path) -> dict[str, str]:
    return without_repository({"PYTHONPATH": str(repository)})


def sweep(repository: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run(command(*arguments), repository, {"PYTHONPATH": str(repository)}, capture_output=True)


def jobs(folder: Path) -> dict[str, dict]:
    """The record of each job by the name of its folder."""
    return {path.parent.name: json.loads(path.read_text()) for path in folder.glob("jobs/*/job.json")}


def results(folder: Path, job: str) -> dict[str, bytes]:
    """What must not depend on where a job runs."""
    names = ("params.yaml", "dvc.lock", "metrics.json", "results.parquet")
    return {name: (folder / "jobs" / job / name).read_bytes() for name in names}
