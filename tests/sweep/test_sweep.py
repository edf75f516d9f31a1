"""A sweep runs for real: in processes of this machine, on a clone of the working tree with a cache of its own."""

import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest

from pipeline.artifacts.files import read_json, read_table
from tests.sweep.running import SMALL, clone_of_working_tree, command, environment, jobs, sweep

pytestmark = pytest.mark.slow
SWEPT = [*SMALL, "evaluate.bins=5,10", "hydra.launcher.n_jobs=2"]


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of the working tree, with an empty cache."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
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
    assert together == ["clearance@clearance", "demos", "evaluate", "evaluate", "scenes"]


def test_a_job_keeps_its_parameters_metrics_log_and_commit(folder: Path, repository: Path):
    kept = folder / "jobs" / "evaluate.bins=5"
    assert "bins: 5" in (kept / "params.yaml").read_text()
    assert "accuracy" in read_json(kept / "metrics.json")["evaluate"]
    assert "evaluate: ran" in (kept / "log.txt").read_text()
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=repository, capture_output=True, text=True).stdout.strip()
    assert read_json(kept / "job.json")["commit"] == head
    assert set(read_table(kept / "results.parquet").columns) == {"headline", "seed", "value"}
    assert not (folder / "clones").exists()


def test_a_failing_job_is_named_and_takes_no_other_along_and_resuming_runs_it_alone(repository: Path, folder: Path):
    before = {name: job["seconds"] for name, job in jobs(folder).items()}
    missing = repository / "data" / "mine.csv"
    values = [*SMALL, "evaluate.bins=10", f"demos.recorded=null,{missing.relative_to(repository)}"]
    other = repository / "failing"
    ended = sweep(repository, "--multirun", *values, "--folder", "failing")
    assert ended.returncode == 1 and "mine.csv" in ended.stderr and "failed" in ended.stderr
    states = {name: job["state"] for name, job in jobs(other).items()}
    assert sorted(states.values()) == ["done", "failed"]
    assert "mine.csv" in (other / "index.html").read_text()
    assert before == {name: job["seconds"] for name, job in jobs(folder).items()}
    done = next(name for name, state in states.items() if state == "done")
    stamp = (other / "jobs" / done / "job.json").stat().st_mtime_ns
    assert sweep(repository, "--resume", "failing").returncode == 1
    assert (other / "jobs" / done / "job.json").stat().st_mtime_ns == stamp


def test_more_values_may_be_added_to_a_sweep_and_only_they_run(repository: Path, folder: Path):
    stamps = {path: path.stat().st_mtime_ns for path in folder.glob("jobs/*/job.json")}
    ended = sweep(repository, "--resume", "swept", *SMALL, "evaluate.bins=5,10,20")
    assert ended.returncode == 0 and "3 of 3 jobs done" in ended.stdout, ended.stderr[-2000:]
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--multirun", *SWEPT, "--folder", "swept"], "holds a sweep already"),
        (["--multirun", *SWEPT, "--folder", "x", "--stages", "evaluates"], "stage 'evaluates' is unknown"),
        (["--resume", "nowhere"], "holds no sweep"),
        (
            ["--multirun", "hydra/sweeper=basic", "evaluate.bins=5", "--folder", "x", "bins"],
            "'bins': expected an override",
        ),
        (["evaluate.bins=5,10"], "--multirun"),
    ],
)
def test_wrong_use_is_refused_and_results_stay(repository: Path, folder: Path, arguments: list[str], message: str):
    results = (folder / "results.parquet").read_bytes()
    ended = sweep(repository, *arguments)
    assert ended.returncode == 2 and message in ended.stderr and "Traceback" not in ended.stderr
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


def test_an_experiment_runs_with_fewer_values_if_the_command_line_names_them(repository: Path):
    fewer = ["scenes.per_seed=6", "scenes.layout.items_per_scene=[1]"]
    ended = sweep(repository, "--multirun", *SMALL, "+experiment=worlds", *fewer, "--folder", "worlds")
    assert ended.returncode == 0 and "2 of 2 jobs done" in ended.stdout, ended.stderr[-2000:]
    table = read_table(repository / "worlds" / "results.parquet")
    assert table["users.careful"].nunique() == 2
    assert "Sweep of users.careful" in (repository / "worlds" / "index.html").read_text()
