"""The whole real graph runs at profile=smoke in a throwaway clone, and what DVC and Hydra promise holds there."""

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).parent.parent


def run(clone: Path, *command: str) -> str:
    """The command's output; fails with all of it if the command does."""
    done = subprocess.run(command, cwd=clone, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def results() -> dict[str, str]:
    """The digest of every committed result as it now lies in the working tree."""
    files = [ROOT / "dvc.lock", *ROOT.glob("outputs/**/metrics.json"), *ROOT.glob("reports/**/*")]
    return {str(p.relative_to(ROOT)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.is_file()}


@pytest.fixture(scope="module")
def committed() -> dict[str, str]:
    """The results before the smoke run."""
    return results()


@pytest.fixture(scope="module")
def clone(committed: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("smoke")
    assert "smoke run complete" in run(ROOT, "bash", "tests/smoke.sh", str(directory))
    return directory


def test_the_committed_results_are_left_alone(committed: dict[str, str], clone: Path):
    assert {"dvc.lock", "outputs/evaluate/metrics.json", "reports/index.html"} <= set(committed)
    assert results() == committed
    assert (clone / "dvc.lock").read_bytes() != (ROOT / "dvc.lock").read_bytes()


def test_a_second_repro_has_nothing_to_do(clone: Path):
    assert "Data and pipelines are up to date" in run(clone, "dvc", "repro")


def test_pictures_of_other_recordings_are_not_shown(clone: Path):
    page = (clone / "reports/index.html").read_text()
    assert "<code>make pictures</code>" in page and "<img" not in page


def test_one_recording_a_variant_user_and_seed(clone: Path):
    assert len(list((clone / "outputs/record/runs").glob("*.rrd"))) >= 6 * 3 * 2


@pytest.mark.parametrize(
    ("stage", "overrides"), [("demos", []), ("train", ["variant=full"]), ("path", ["variant=path"]), ("evaluate", [])]
)
def test_a_stage_run_by_hand_writes_the_bytes_dvc_has(clone: Path, tmp_path: Path, stage: str, overrides: list[str]):
    module = f"pipeline.stages.{stage}"
    again = f"paths.{stage}={tmp_path}"
    run(clone, sys.executable, "-m", module, "--params", "params.yaml", again, *overrides)
    written = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert written
    for path in written:
        first = clone / "outputs" / stage / path.relative_to(tmp_path)
        assert path.read_bytes() == first.read_bytes(), f"{path.relative_to(tmp_path)} differs on a second run"


def test_recordings_written_twice_have_the_same_digests(clone: Path, tmp_path: Path):
    run(clone, sys.executable, "-m", "pipeline.stages.record", "--params", "params.yaml", f"paths.record={tmp_path}")
    first = clone / "outputs" / "record" / "recordings.csv"
    assert (tmp_path / "recordings.csv").read_bytes() == first.read_bytes()


def test_a_run_killed_in_the_middle_is_made_good_by_the_next(clone: Path):
    stage = clone / "outputs" / "train" / "classifier"
    before = {p.relative_to(stage): p.read_bytes() for p in stage.rglob("*") if p.is_file()}
    command = ["dvc", "repro", "--force", "--single-item", "train@classifier"]
    killed = subprocess.Popen(command, cwd=clone, start_new_session=True, stdout=subprocess.DEVNULL)
    while not any("pipeline.stages.train" in part for part in of_its_children(killed.pid)):
        assert killed.poll() is None, "the stage ended before it could be killed"
        time.sleep(0.02)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not (stage / "predictions.parquet").exists()
    run(clone, "dvc", "repro")
    assert {p.relative_to(stage): p.read_bytes() for p in stage.rglob("*") if p.is_file()} == before
    assert "Data and pipelines are up to date" in run(clone, "dvc", "repro")


def of_its_children(pid: int) -> list[str]:
    """The command lines of a process's children, their children among them, in parts."""
    parts: list[str] = []
    for child in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            parts += child.cmdline()
    return parts


def test_make_repro_goes_on_where_dvc_was_killed_while_it_wrote_its_lock(clone: Path):
    (clone / ".dvc/tmp/rwlock").write_text("")
    refused = subprocess.run(["dvc", "repro"], cwd=clone, capture_output=True, text=True)
    assert refused.returncode != 0 and "rwlock" in refused.stderr
    run(clone, "make", "--assume-old=.venv/.ready", "repro")
    assert "Data and pipelines are up to date" in run(clone, "dvc", "repro")


def test_a_hydra_multirun_fits_what_dvc_fits(clone: Path, tmp_path: Path):
    sweep = ["--multirun", "seed=0,1", "variant=ae", "profile=smoke", "n=[9]", f"hydra.sweep.dir={tmp_path}"]
    run(clone, sys.executable, "-m", "pipeline.stages.train", *sweep)
    assert len([p for p in tmp_path.iterdir() if p.is_dir()]) == 2
    weights = "weights/careful-s1-n9.safetensors"
    (swept,) = tmp_path.glob(f"*seed=1*variant=ae*/ae/{weights}")
    assert swept.read_bytes() == (clone / "outputs/train/ae" / weights).read_bytes()


def test_dvc_shows_metrics_and_plots(clone: Path):
    metrics = json.loads(run(clone, "dvc", "metrics", "show", "--json"))
    assert "reports/metrics.json" in metrics[""]["data"]
    run(clone, "dvc", "plots", "show", "--out", "plots")
    assert (clone / "plots" / "index.html").stat().st_size > 0


def test_an_experiment_recomposes_the_parameters(clone: Path):
    run(clone, "dvc", "exp", "run", "-S", "profile=smoke", "-S", "evaluate.bins=7", "evaluate")
    assert "bins: 7" in (clone / "params.yaml").read_text()
    assert "evaluate.bins" in run(clone, "dvc", "params", "diff")
