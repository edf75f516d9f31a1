"""A stage from the command line: its folder bears its name, and what goes wrong is one line."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.runtime.errors import InputError

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("given", [[], ["hydra.job.name=mine"]])
def test_hydra_s_folders_bear_the_stage_s_name_unless_another_is_given(given: list[str]):
    command = [sys.executable, "-m", "pipeline.stages.demos", "--cfg", "hydra", *given]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert f"  job:\n    name: {'mine' if given else 'demos'}\n" in printed


@pytest.mark.parametrize("error", [InputError, FileNotFoundError, PermissionError, FileExistsError])
def test_an_error_is_one_line_and_exit_code_2(
    error: type[Exception], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    def main(cfg: DictConfig, out_dir: Path) -> None:
        raise error("no room")

    at = ["--params", str(ROOT / "params.yaml"), f"paths.scenes={tmp_path}"]
    monkeypatch.setattr(sys, "argv", ["stage", *at])
    with pytest.raises(SystemExit) as left:
        launch(main, "scenes")
    assert left.value.code == 2
    assert capsys.readouterr().err == "error: no room\n"


def test_a_defect_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    def main(cfg: DictConfig, out_dir: Path) -> None:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(sys, "argv", ["stage", "--params", str(ROOT / "params.yaml"), f"paths.scenes={tmp_path}"])
    with pytest.raises(ValueError, match="broadcast"):
        launch(main, "scenes")


def test_a_file_where_the_folder_should_be_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    (tmp_path / "taken").write_text("")
    monkeypatch.setattr(
        sys, "argv", ["stage", "--params", str(ROOT / "params.yaml"), f"paths.scenes={tmp_path / 'taken'}"]
    )
    with pytest.raises(SystemExit) as left:
        launch(lambda cfg, out_dir: None, "scenes")
    assert left.value.code == 2
    assert os.fspath(tmp_path / "taken") in capsys.readouterr().err


def test_a_sweep_goes_on_after_a_bad_value_and_says_that_one_failed(tmp_path: Path):
    sweep = ["--multirun", "selftest.families=0,1", f"hydra.sweep.dir={tmp_path}", f"paths.intervene={tmp_path}"]
    command = [sys.executable, "-m", "pipeline.stages.selftest", *sweep]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    first, second = (line for line in run.stderr.splitlines() if line.startswith("error: "))
    assert "selftest.families is 0" in first and "effects.parquet is missing" in second
    assert run.returncode == 2 and "Traceback" not in run.stderr


def test_variants_fitted_by_one_stage_lie_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    seen = []
    hydra = [f"hydra.run.dir={tmp_path}", "variant=ae"]
    monkeypatch.setattr(sys, "argv", ["train.py", *hydra])
    launch(lambda cfg, out_dir: seen.append(out_dir), "train")
    assert seen == [tmp_path / "ae"]


def test_ctrl_c_ends_a_stage_and_its_workers_at_once(tmp_path: Path):
    script = """
import time
from pipeline.launch import launch
from pipeline.runtime.parallel import map_jobs
if __name__ == "__main__":
    launch(lambda cfg, out_dir: map_jobs(time.sleep, [100.0, 100.0, 100.0], 2, "asleep"), "scenes")
"""
    (tmp_path / "stage.py").write_text(script)
    command = [sys.executable, "stage.py", "--params", str(ROOT / "params.yaml"), f"paths.scenes={tmp_path / 'out'}"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    stage = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored, where the tests run behind `&`
    )  # fmt: skip
    while len(workers := psutil.Process(stage.pid).children(recursive=True)) < 3:  # two, and what keeps track of them
        time.sleep(0.1)
    time.sleep(2)  # in the middle of their imports
    os.killpg(stage.pid, signal.SIGINT)
    _, said = stage.communicate(timeout=20)
    assert stage.returncode == 130
    assert said.decode().splitlines()[-1].endswith("error: interrupted") and "Traceback" not in said.decode()
    assert not psutil.wait_procs(workers, timeout=20)[1]


def test_a_sweep_over_what_the_stage_does_not_read_is_refused(tmp_path: Path, monkeypatch, capsys):
    """Its results would be the same under both names."""
    seen = []
    sweep = ["--multirun", f"hydra.sweep.dir={tmp_path}", "variant=ae", "scenes.per_seed=5,20"]
    monkeypatch.setattr(sys, "argv", ["train.py", *sweep])
    with pytest.raises(SystemExit):
        launch(lambda cfg, out_dir: seen.append(cfg.scenes.per_seed), "train")
    assert seen == [5]
    assert "scenes.per_seed=20,variant=ae: nothing that stage train reads differs from" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["train.py", *sweep[:-1], "train.steps=5,20", "seeds=[0],[1]"])
    launch(lambda cfg, out_dir: seen.append((cfg.train.steps, *cfg.protocol.seeds)), "train")
    assert seen[1:] == [(5, 0), (5, 1), (20, 0), (20, 1)]


def test_a_sweep_over_seeds_is_refused_by_a_stage_that_takes_them_all(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["evaluate.py", "--multirun", f"hydra.sweep.dir={tmp_path}", "seed=0,1"])
    with pytest.raises(SystemExit):
        launch(lambda cfg, out_dir: None, "evaluate")
    assert "seed=1: nothing that stage evaluate reads differs from" in capsys.readouterr().err


def test_flags_of_hydra_may_follow_overrides(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["train.py", f"hydra.run.dir={tmp_path}", "profile=smoke", "--cfg", "job"])
    launch(lambda cfg, out_dir: pytest.fail("only shown"), "train")
    assert "variant: full" in capsys.readouterr().out


def test_one_seed_alone_is_for_sweeps_since_dvc_would_lose_the_others(tmp_path: Path):
    command = [
        sys.executable,
        "-m",
        "pipeline.stages.train",
        "--params",
        "params.yaml",
        "seed=0",
        f"paths.train={tmp_path}",
    ]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 2 and "parameter seed is 0: expected null" in run.stderr and not list(tmp_path.iterdir())
