"""A stage from the command line: its folder bears its name, and what goes wrong is one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from omegaconf import DictConfig

from pipeline.launch import launch

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("given", [[], ["hydra.job.name=mine"]])
def test_hydra_s_folders_bear_the_stage_s_name_unless_another_is_given(given: list[str]):
    command = [sys.executable, "-m", "pipeline.stages.demos", "--cfg", "hydra", *given]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert f"  job:\n    name: {'mine' if given else 'demos'}\n" in printed


@pytest.mark.parametrize("error", [ValueError, FileNotFoundError, PermissionError, FileExistsError])
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
