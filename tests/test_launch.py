"""A stage from the command line: what goes wrong is one line, and Ctrl-C ends all of it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import psutil
import pytest
from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT

pytestmark = pytest.mark.slow

PARAMS = ["--params", str(ROOT / "params.yaml")]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Launch a stage within this process; its exit code, stdout and stderr."""

    def run(main: Callable, stage: str, *arguments: str) -> tuple[int, str, str]:
        there = f"studies.{stage}.stage" if (ROOT / "studies" / stage).is_dir() else f"pipeline.stages.{stage}"
        main.__module__ = import_module(there).__name__  # whose Settings check the parameters
        monkeypatch.setattr(sys, "argv", [f"{stage}.py", *arguments])
        monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
        code = 0
        try:
            launch(main, stage)
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else 1
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def test_a_person_s_error_is_one_line_and_exit_code_2_and_a_defect_keeps_its_traceback(run, tmp_path: Path):
    def raising(error: type[Exception]) -> Callable:
        def main(cfg: DictConfig, out_dir: Path) -> None:
            raise error("no room")

        return main

    by_dvc, by_hydra = [*PARAMS, f"paths.scenes={tmp_path}"], [f"hydra.run.dir={tmp_path}"]
    for error, arguments in ((InputError, by_hydra), (PermissionError, by_dvc)):
        code, _, err = run(raising(error), "scenes", *arguments)
        assert code == 2 and err.splitlines()[-1] == "error: no room"
    with pytest.raises(ValueError, match="no room"):
        run(raising(ValueError), "scenes", *by_dvc)


def test_an_experiment_that_is_refused_says_how_its_stage_s_outputs_come_back(run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("DVC_STAGE", "scenes")
    monkeypatch.setenv("DVC_EXP_NAME", "some-name")  # dvc exp run -S scenes.per_seed=-1
    code, _, err = run(lambda cfg, out_dir: None, "scenes", *PARAMS, "scenes.per_seed=-1")
    assert code == 2 and "`git checkout outputs && dvc checkout scenes` restores them" in err


def test_a_sweep_goes_on_after_a_bad_value_names_it_and_fails(run, tmp_path: Path):
    rates = []
    sweep = ["--multirun", "train.rate=-1,0.5", f"hydra.sweep.dir={tmp_path}"]
    code, _, err = run(lambda cfg, out_dir: rates.append(cfg.train.rate), "train", *sweep)
    assert code == 2 and rates == [0.5]
    assert "error: train.rate=-1: parameter train.rate is -1" in err


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_ctrl_c_or_a_kill_ends_a_stage_and_its_workers_at_once(tmp_path: Path, sent: signal.Signals):
    script = """
import time
from pipeline.launch import launch
from pipeline.runtime.parallel import map_jobs
if __name__ == "__main__":
    launch(lambda cfg, out_dir: map_jobs(time.sleep, [100.0, 100.0, 100.0], 2, "asleep"), "scenes")
"""
    (tmp_path / "stage.py").write_text(script)
    command = [sys.executable, "stage.py", *PARAMS, f"paths.scenes={tmp_path / 'out'}"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    stage = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored, where the tests run behind `&`
    )  # fmt: skip
    while len(workers := psutil.Process(stage.pid).children(recursive=True)) < 3:  # two, and what keeps track of them
        assert stage.poll() is None, "it ended before its workers began"
        time.sleep(0.1)
    if sent == signal.SIGINT:
        time.sleep(2)  # in the middle of their imports
        os.killpg(stage.pid, sent)
    else:
        time.sleep(15)  # at work
        stage.kill()
    _, stderr = stage.communicate(timeout=20 if sent == signal.SIGINT else 120)
    assert stage.returncode == (130 if sent == signal.SIGINT else -sent)
    assert "Traceback" not in stderr.decode()
    assert sent == signal.SIGKILL or stderr.decode().splitlines()[-1].endswith("error: interrupted")
    assert not [one for one in psutil.wait_procs(workers, timeout=20)[1] if one.status() != psutil.STATUS_ZOMBIE]
