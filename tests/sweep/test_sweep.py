"""A sweep runs for real: in processes of this machine, on a clone of the working tree with a cache of its own."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pipeline.artifacts.files import read_json, read_table
from pipeline.git import git
from tests.sweep.running import SMALL, clone_of_working_tree, command, environment, jobs, sweep

pytestmark = pytest.mark.slow
SWEPT = [*SMALL, "evaluate.bins=5,10", "hydra.launcher.n_jobs=2"]


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of the working tree, with an empty cache."""
    return clone_of_working_tree(tmp_path_factory.mktemp("sweeps") / "repository")


@pytest.fixture(scope="module")
def folder(repository: Path) -> Path:
    """The folder of a sweep of two jobs that differ in the last stage alone."""
    ended = sweep(repository, "--multirun", *SWEPT, "--folder", "swept")
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert "2 of 2 jobs done" in ended.stdout
    return repository / "swept"


def test_a_stage_that_jobs_have_in_common_runs_once_though_they_start_together(folder: Path):
    ran = {name: sorted(s for s, stage in job["stages"].items() if stage["ran"]) for name, job in jobs(folder).items()}
    assert sorted(ran) == ["evaluate.bins=10", "evaluate.bins=5"]
    together = sorted(stage for stages in ran.values() for stage in stages)
    assert together == ["clearance@clearance", "demos", "evaluate", "evaluate", "params", "params", "scenes"]


def test_a_job_keeps_its_parameters_metrics_log_and_commit(folder: Path, repository: Path):
    kept = folder / "jobs" / "evaluate.bins=5"
    assert "bins: 5" in (kept / "params.yaml").read_text()
    assert "accuracy" in read_json(kept / "metrics.json")["evaluate"]
    assert "evaluate: ran" in (kept / "log.txt").read_text()
    assert read_json(kept / "job.json")["commit"] == git(repository, "rev-parse", "HEAD").strip()
    assert set(read_table(kept / "results.parquet").columns) == {"headline", "seed", "value"}
    assert not (folder / "clones").exists()


def test_a_failing_job_takes_no_other_along_and_resuming_runs_it_and_added_values_alone(repository: Path, folder: Path):
    before = {name: job["seconds"] for name, job in jobs(folder).items()}
    missing = "demos.recorded=null,data/mine.csv"
    other = repository / "größer (2), 'mine'"
    ended = sweep(repository, "--multirun", *SMALL, "evaluate.bins=10", missing, "--folder", other.name)
    assert ended.returncode == 1 and "mine.csv" in ended.stderr and "failed" in ended.stderr
    (done,) = (name for name, job in jobs(other).items() if job["state"] == "done")
    assert "mine.csv" in (other / "index.html").read_text()
    assert before == {name: job["seconds"] for name, job in jobs(folder).items()}
    stamp = (other / "jobs" / done / "job.json").stat().st_mtime_ns
    ended = sweep(repository, "--resume", other.name, *SMALL, "evaluate.bins=20", missing)
    assert ended.returncode == 1 and "2 of 4 jobs done" in ended.stdout, ended.stderr[-2000:]
    assert sorted(job["state"] for job in jobs(other).values()) == ["done", "done", "failed", "failed"]
    assert (other / "jobs" / done / "job.json").stat().st_mtime_ns == stamp
    shutil.rmtree(other / "jobs" / done)
    ended = sweep(repository, "--resume", other.name)
    assert ended.returncode == 1 and "2 of 4 jobs done" in ended.stdout, "the first run's job, too"


def test_a_job_in_a_used_clone_runs_what_its_parameters_change_though_outputs_are_those_of_the_lock(
    repository: Path, folder: Path
):
    """After the first job the clone's outputs are those of HEAD's lock, but for its parameters."""
    first, second = (folder / "jobs" / f"evaluate.bins={bins}" for bins in (5, 10))
    other = clone_of_working_tree(repository.parent / "locked")
    shutil.copy(first / "dvc.lock", other)
    git(other, "-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qam", "lock")
    (other / ".dvc" / "config.local").write_text(f"[cache]\n    dir = {repository / '.dvc' / 'cache'}\n")
    ended = sweep(other, "--multirun", *SWEPT[:-1], "hydra/launcher=basic", "--folder", "again")
    assert ended.returncode == 0, ended.stderr[-2000:]
    for job in (first, second):
        again = other / "again" / "jobs" / job.name
        assert (again / "results.parquet").read_bytes() == (job / "results.parquet").read_bytes()
        assert (again / "dvc.lock").read_bytes() == (job / "dvc.lock").read_bytes()


def test_after_a_kill_the_folder_is_all_that_resuming_needs(repository: Path, folder: Path):
    """Also where the command line says in other words what all jobs share: their seeds, how they are launched."""
    arguments = ["--multirun", *SMALL, "seed=0,1", "evaluate.bins=5,7", "hydra/launcher=basic", "--folder", "killed"]
    place = {"cwd": repository, "env": environment(repository)}
    started = subprocess.Popen(command(*arguments), **place, start_new_session=True)
    while not (repository / "killed" / "jobs").is_dir():
        assert started.poll() is None
        time.sleep(0.1)
    started.kill()
    started.wait(timeout=60)
    for more in ([], ["profile=smoke", "hydra/launcher=joblib"]):
        ended = sweep(repository, "--resume", "killed", *more)
        assert ended.returncode == 0 and "2 of 2 jobs done" in ended.stdout, ended.stderr[-2000:]


WRONG = {
    "holds a sweep already": ["--multirun", *SWEPT, "--folder", "swept"],
    "stage 'evaluates' is unknown": ["--multirun", *SWEPT, "--folder", "x", "--stages", "evaluates"],
    "stage 'selection' keeps": ["--multirun", *SWEPT, "--folder", "x", "--stages", "selection"],
    "holds no sweep": ["--resume", "nowhere"],
    "'bins': expected an override": ["--multirun", "hydra/sweeper=basic", "evaluate.bins=5", "--folder", "x", "bins"],
    "start with --multirun": ["evaluate.bins=5,10"],
    "the launcher failed (ValueError": ["--multirun", *SWEPT[:-1], "hydra.launcher.n_jobs=0", "--folder", "unlaunched"],
}


def test_wrong_use_is_refused_and_results_stay(repository: Path, folder: Path):
    results = (folder / "results.parquet").read_bytes()
    code = f"from pipeline.sweep.__main__ import main; print(*map(main, {list(WRONG.values())}))"
    place = {"cwd": repository, "env": environment(repository)}
    ended = subprocess.run([sys.executable, "-c", code], **place, capture_output=True, text=True)
    assert ended.stdout.splitlines()[-1].split() == ["2"] * len(WRONG), ended.stderr
    assert all(message in ended.stderr for message in WRONG), ended.stderr
    assert (folder / "results.parquet").read_bytes() == results and not (repository / "x").exists()


def test_a_folder_of_other_code_and_one_in_use_are_refused(repository: Path, folder: Path):
    edited = repository / "conf" / "evaluate.yaml"
    text = edited.read_text()
    edited.write_text(text + "# edited\n")
    ended = sweep(repository, "--resume", "swept")
    edited.write_text(text)
    assert ended.returncode == 2 and "the code has changed" in ended.stderr
    with subprocess.Popen(["flock", folder / ".lock", "sleep", "60"]) as holder:
        time.sleep(0.5)
        ended = sweep(repository, "--resume", "swept")
        for process in [*psutil.Process(holder.pid).children(), holder]:
            process.terminate()
    assert ended.returncode == 2 and "another sweep is writing" in ended.stderr


@pytest.mark.skipif(os.geteuid() != 0 or sys.platform != "linux", reason="mounts a small disk")
def test_a_full_disk_is_named_and_resuming_with_room_runs_what_it_stopped(repository: Path, folder: Path):
    results = (folder / "results.parquet").read_bytes()
    disk = repository / "small_disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk], check=True)
    try:
        ended = sweep(repository, "--multirun", *SWEPT, "--folder", "small_disk/swept")
        assert ended.returncode in (1, 2) and f"the disk of {disk}/swept is full" in ended.stderr, ended.stderr[-2000:]
        assert "Traceback" not in ended.stderr and (folder / "results.parquet").read_bytes() == results
        subprocess.run(["mount", "-o", "remount,size=900m", disk], check=True)
        ended = sweep(repository, "--resume", "small_disk/swept")
        assert ended.returncode == 0 and "2 of 2 jobs done" in ended.stdout, ended.stderr[-2000:]
        assert (disk / "swept" / "results.parquet").read_bytes() == results
    finally:
        subprocess.run(["umount", "--lazy", disk], check=True)


@pytest.mark.parametrize(("sent", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_ctrl_c_or_a_kill_ends_every_process(repository: Path, sent: signal.Signals, status: int):
    arguments = ["--multirun", *SMALL, f"scenes.root_seed={sent}1,{sent}2", "--folder", f"stopped{sent}"]
    heard = lambda: signal.signal(signal.SIGINT, signal.default_int_handler)  # noqa: E731  # a shell's & mutes it
    place = {"cwd": repository, "env": environment(repository)}
    started = subprocess.Popen(command(*arguments), **place, start_new_session=True, preexec_fn=heard)
    log = repository / f"stopped{sent}" / "jobs" / f"scenes.root_seed={sent}1" / "log.txt"
    while not log.is_file() or "Running stage" not in log.read_text():
        assert started.poll() is None
        time.sleep(0.2)
    started.send_signal(sent)
    assert started.wait(timeout=60) == status
    time.sleep(4)
    left = [p.cmdline() for p in psutil.process_iter(["cwd"]) if str(repository) in str(p.info["cwd"])]
    assert not left
    assert {job["state"] for job in jobs(log.parents[2]).values()} <= {"running", "interrupted"}
