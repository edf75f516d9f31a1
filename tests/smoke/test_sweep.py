"""A sweep runs for real: in processes of this machine, on a clone of the working tree with a cache of its own."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pipeline.artifacts.files import read_json, read_table
from pipeline.git import dvc, git, run
from tests.sweep.running import SMALL, clone_of_working_tree, command, environment, jobs, sweep

pytestmark = pytest.mark.slow
SWEPT = ["evaluate.bins=5,10", "scenes.layout.clear_of_ends=0.12,0.9"]
DONE, OTHER = (f"evaluate.bins={bins},scenes.layout.clear_of_ends=0.12" for bins in (5, 10))


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone with an empty cache, in which a sweep of four jobs was run, two of which fail: no item fits the table."""
    clone = clone_of_working_tree(tmp_path_factory.mktemp("sweeps") / "größer (2), 'mine'")
    ended = sweep(clone, "--multirun", *SMALL, *SWEPT, "hydra.launcher.n_jobs=2", "--folder", "swept")
    assert ended.returncode == 1 and "2 of 4 jobs done" in ended.stdout, ended.stderr[-3000:]
    assert "no room for" in ended.stderr and "log.txt" in ended.stderr
    return clone


def test_jobs_share_stages_a_failing_one_takes_no_other_along_and_each_keeps_its_results(repository: Path):
    folder = repository / "swept"
    states = {name: job["state"] for name, job in jobs(folder).items()}
    assert sorted(states.values()) == ["done", "done", "failed", "failed"] and states[DONE] == states[OTHER] == "done"
    logs = "".join((folder / "jobs" / name / "log.txt").read_text() for name in (DONE, OTHER))
    ran = [logs.count(f"Running stage '{stage}'") for stage in ("scenes", "clearance@clearance", "evaluate")]
    assert ran == [1, 1, 2]
    assert "no room for" in (folder / "index.html").read_text() and not (folder / "clones").exists()
    assert "bins: 5" in (folder / "jobs" / DONE / "params.yaml").read_text()
    assert set(read_table(folder / "jobs" / DONE / "results.parquet").columns) == {"headline", "seed", "value"}
    assert jobs(folder)[DONE]["commit"] == git(repository, "rev-parse", "HEAD").strip()
    assert not git(repository, "status", "--porcelain", "--untracked-files=no")


def test_a_job_has_the_results_of_a_run_by_hand(repository: Path):
    hand = clone_of_working_tree(repository.parent / "hand")
    (hand / ".dvc/config.local").write_text(f'[cache]\n    dir = "{repository}/.dvc/cache"\n')
    composed = [sys.executable, "-m", "pipeline.params", *SMALL, "evaluate.bins=5"]
    run(composed, hand, {"PYTHONPATH": str(hand)}, check=True, capture_output=True)
    dvc(hand, "pull", "--remote", "store", "data.dvc")
    run([sys.executable, "-m", "dvc", "repro", "evaluate"], hand, {"PYTHONPATH": str(hand)}, check=True)
    metrics = read_json(repository / "swept/jobs" / DONE / "metrics.json")
    assert metrics["evaluate"] == read_json(hand / "outputs/evaluate/metrics.json")


def test_resuming_runs_added_values_and_what_failed_alone_and_wrong_use_is_refused(repository: Path):
    file = repository / "swept/jobs" / DONE / "job.json"
    before = file.read_bytes()
    more = ["evaluate.bins=20", "scenes.layout.clear_of_ends=0.12", "hydra/launcher=basic"]
    ended = sweep(repository, "--resume", "swept", *more)
    assert ended.returncode == 1 and "3 of 5 jobs done" in ended.stdout, ended.stderr[-2000:]
    assert file.read_bytes() == before
    wrong = {
        "holds a sweep already": ["--multirun", *SMALL, "--folder", "swept"],
        "stage 'evaluates' is unknown": ["--multirun", *SMALL, "--folder", "x", "--stages", "evaluates"],
        "nowhere holds no sweep": ["--resume", "nowhere"],
        "'bins': expected an override": ["--multirun", "evaluate.bins=5", "--folder", "x", "bins"],
        "expected --multirun": ["evaluate.bins=5,10"],
    }
    code = f"from pipeline.sweep.__main__ import main\nfor words in {list(wrong.values())}:\n  try: main(words)\n"
    code += "  except ValueError as error: print(error)"
    ended = run([sys.executable, "-c", code], repository, {"PYTHONPATH": str(repository)}, capture_output=True)
    told = zip(wrong, ended.stdout.splitlines(), strict=True)
    assert all(message in sentence for message, sentence in told), ended.stderr
    assert not (repository / "x").exists()


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
