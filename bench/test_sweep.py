"""Time a job of a sweep whose stages are all in the cache, by launcher, against a bare loop over `dvc repro`.

The jobs differ in a parameter that no stage up to the target reads, so that all of their time is overhead.
"""

import shutil
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from pipeline.git import dvc, git, run
from tests.sweep.running import SMALL, clone_of_working_tree, sweep

JOBS = 8
LAUNCHERS = ("basic", "joblib", "ray", "submitit_local")  # the last two need the environment of `make bench`
TARGET = ["--stages", "demos"]


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone whose cache holds every stage up to demos."""
    clone = clone_of_working_tree(tmp_path_factory.mktemp("bench") / "repository")
    ended = sweep(clone, "--multirun", *SMALL, *TARGET, "--folder", "warm")
    assert ended.returncode == 0, ended.stderr
    dvc(clone, "pull", "--quiet", "--remote", "store", "data.dvc")
    return clone


def bare_loop(repository: Path) -> None:
    """Compose and reproduce one after the other in one folder, outputs removed before each."""
    for value in range(JOBS):
        shutil.rmtree(repository / "outputs", ignore_errors=True)
        compose = ["pipeline.params", *SMALL, f"report.scenes={value + 1}"]
        for arguments in (compose, ["dvc", "repro", "demos"]):
            there = {"PYTHONPATH": str(repository)}
            run([sys.executable, "-m", *arguments], repository, there, check=True, capture_output=True)


def test_bare_loop(benchmark, repository: Path):
    start = time.perf_counter()
    benchmark.pedantic(bare_loop, args=(repository,), rounds=1)
    benchmark.extra_info["results"] = {"sweep_job_s_bare_loop": (time.perf_counter() - start) / JOBS}
    git(repository, "checkout", "--quiet", ".")  # a sweep would keep the composed overrides


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_sweep(benchmark, repository: Path, tmp_path: Path, launcher: str):
    extra = launcher.partition("_")[0]
    if extra in ("ray", "submitit") and find_spec(f"hydra_plugins.hydra_{extra}_launcher") is None:
        pytest.skip(f"needs the extra {extra}")
    values = f"report.scenes={','.join(str(value + 1) for value in range(JOBS))}"
    folder = ["--folder", str(tmp_path / "swept")]
    arguments = ["--multirun", *SMALL, values, f"hydra/launcher={launcher}", *TARGET, *folder]
    start = time.perf_counter()
    ended = benchmark.pedantic(sweep, args=(repository, *arguments), rounds=1)
    benchmark.extra_info["results"] = {f"sweep_job_s_{launcher}": (time.perf_counter() - start) / JOBS}
    assert ended.returncode == 0, ended.stderr
