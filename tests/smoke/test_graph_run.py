"""The whole graph runs at profile smoke in a throwaway clone, and what DVC and Hydra promise holds there."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import yaml

from pipeline.artifacts.files import read_table, write_table
from pipeline.launch import load
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.stages.page import read_study, render
from tests.smoke.reproduce import reproduce

UP_TO_DATE = "Data and pipelines are up to date"
MAX_NUMBERS = 60  # of `dvc metrics show`: what fits on a screen


def run(clone: Path, *command: str) -> str:
    """The command's output; fails with all of it if the command does."""
    done = subprocess.run(command, cwd=clone, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def files(folder: Path) -> dict[str, bytes]:
    """The contents of files, without recordings, which hold the time at which they were written."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".rrd")
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def numbers(value: object) -> int:
    """How many numbers a nest of dictionaries holds."""
    return sum(numbers(part) for part in value.values()) if isinstance(value, dict) else 1


def fresh_clone(clone: Path, directory: Path) -> Path:
    """A git clone of the smoke run's last commit, without DVC's cache."""
    run(clone, "git", "clone", "--quiet", str(clone), str(directory))
    return directory


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smoke run, its results committed, and the repository's own left as they were."""
    locks = [ROOT / "dvc.lock", ROOT / "studies/dvc.lock", *sorted(ROOT.glob("studies/*/dvc.lock"))]
    before = [path.read_bytes() if path.is_file() else None for path in locks]
    directory = tmp_path_factory.mktemp("smoke")
    assert "smoke run complete" in run(ROOT, "bash", "tests/smoke/run.sh", str(directory))
    assert [path.read_bytes() if path.is_file() else None for path in locks] == before
    return directory


def test_a_second_repro_runs_no_stage_and_every_output_is_listed(clone: Path):
    assert UP_TO_DATE in run(clone, "dvc", "repro", "-P")
    for path in [clone / "dvc.lock", *clone.glob("studies/*/dvc.lock")]:  # not of pages
        for name, stage in yaml.safe_load(path.read_text())["stages"].items():
            listed = {Path(out["path"]) for out in stage["outs"]}
            for folder in {out.parent for out in listed if (clone / out).is_file()}:  # what is no folder as a whole
                written = {p.relative_to(clone) for p in (clone / folder).iterdir() if p.name != ".gitignore"}
                if name not in ("params", "record", "report"):  # results, pages, code besides
                    assert written <= listed, f"{name} writes {written - listed}, which no dvc.yaml lists"


def test_each_study_has_a_page_that_the_overview_links_to_and_that_refuses_tables_without_numbers(
    clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    overview = (clone / "reports/index.html").read_text()
    monkeypatch.chdir(clone)
    shutil.copytree("outputs/studies", tmp_path / "studies")
    for path in (path for path in (tmp_path / "studies").rglob("*") if path.suffix in (".csv", ".parquet")):
        table = read_table(path)
        write_table(path, table.assign(**dict.fromkeys(table.select_dtypes("float").columns, float("nan"))))
    cfg = load(Path("params.yaml"), [f"paths.studies={tmp_path / 'studies'}"])
    for name in sorted(path.parent.name for path in clone.glob("studies/*/page.html.j2")):  # those that ran
        assert f"../studies/{name}/index.html" in overview
        assert "smoke run" in (clone / "studies" / name / "index.html").read_text()
        with pytest.raises((InputError, ValueError), match=r"finite|has 0 rows"):  # chosen by its number, a row is gone
            render(read_study(cfg, name), Path("studies") / name)


def test_metrics_are_a_screenful(clone: Path):
    shown = json.loads(run(clone, "dvc", "metrics", "show", "--json"))[""]["data"]
    assert 20 <= sum(numbers(file["data"]) for file in shown.values()) <= MAX_NUMBERS
    assert "reports/metrics.json" not in shown
    assert all("error" not in file for file in shown.values()), "DVC takes a key named error for a failure"


def test_two_workers_in_a_folder_of_another_name_write_the_same_bytes(clone: Path, tmp_path: Path):
    """Also of recordings.csv, which holds the digests of recordings."""
    other = tmp_path / "a folder of another name"
    shutil.copytree(clone, other, ignore=shutil.ignore_patterns(".git", ".dvc", "outputs", "reports"))
    reproduce(other, ["dvc.yaml"], "profile=smoke", "workers=2")
    for folder in ("outputs", "reports"):
        first, second = files(clone / folder), files(other / folder)
        assert second and {name: first.get(name) for name in second} == second


def test_a_fresh_clone_of_a_stale_commit_names_the_stale_stage(clone: Path, tmp_path: Path):
    fresh, question = fresh_clone(clone, tmp_path / "fresh"), ["dvc", "repro", "--dry", "--allow-missing"]
    assert UP_TO_DATE in run(fresh, *question)
    run(fresh, "dvc", "pull", "--allow-missing")  # what was never pushed is no error
    assert (fresh / "data/items.csv").is_file()
    params = fresh / "params.yaml"
    params.write_text(params.read_text().replace("train:\n  steps: 8\n", "train:\n  steps: 9\n"))
    answer = subprocess.run(question, cwd=fresh, capture_output=True, text=True)
    assert "train@full" in answer.stdout + answer.stderr and UP_TO_DATE not in answer.stdout


def test_results_pushed_to_a_remote_arrive_in_a_fresh_clone(clone: Path, tmp_path: Path):
    (tmp_path / "remote").mkdir()
    fresh = fresh_clone(clone, tmp_path / "fresh")
    for repository in (clone, fresh):
        run(repository, "dvc", "remote", "add", "--local", "--default", "lab", str(tmp_path / "remote"))
    try:
        run(clone, "dvc", "push", "--all-commits")
    finally:
        run(clone, "dvc", "remote", "remove", "--local", "lab")
    run(fresh, "dvc", "pull")
    assert UP_TO_DATE in run(fresh, "dvc", "repro", "-P")
    assert run(fresh, "git", "status", "--porcelain") == ""
    recorded = fresh / "reports/recordings/recordings.csv"
    digests = recorded.read_bytes()
    run(fresh, "make", "--assume-old=.venv/.ready", "repro")
    assert recorded.read_bytes() == digests and (fresh / "outputs/record/runs/overview.rrd").is_file()
    assert run(fresh, "git", "status", "--porcelain") == ""


def test_make_repro_makes_good_what_was_killed_even_while_dvc_wrote_its_lock(clone: Path):
    stage = clone / "outputs" / "train" / "classifier"
    before = files(stage)
    command = ["dvc", "repro", "--force", "--single-item", "train@classifier"]
    killed = subprocess.Popen(command, cwd=clone, start_new_session=True, stdout=subprocess.DEVNULL)
    while not any("pipeline.stages.train" in part for part in children_of(killed.pid)):
        assert killed.poll() is None, "the stage ended before it could be killed"
        time.sleep(0.02)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not (stage / "predictions.parquet").exists()
    (clone / ".dvc/tmp/rwlock").write_text("")
    refused = subprocess.run(["dvc", "repro"], cwd=clone, capture_output=True, text=True)
    assert refused.returncode != 0 and "rwlock" in refused.stderr
    run(clone, "make", "--assume-old=.venv/.ready", "repro")
    assert files(stage) == before


def children_of(pid: int) -> list[str]:
    """The command lines of a process's children and their children, in parts."""
    parts: list[str] = []
    for child in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            parts += child.cmdline()
    return parts


def test_a_hydra_multirun_fits_what_dvc_fits(clone: Path, tmp_path: Path):
    sweep = ["--multirun", "seed=0,1", "variant=ae", "profile=smoke", "n_demos=[9]", f"hydra.sweep.dir={tmp_path}"]
    run(clone, sys.executable, "-m", "pipeline.stages.train", *sweep)
    assert len([p for p in tmp_path.iterdir() if p.is_dir()]) == 2
    weights = "weights/careful-s1-n9.safetensors"
    (swept,) = tmp_path.glob(f"*seed=1*variant=ae*/ae/{weights}")
    assert swept.read_bytes() == (clone / "outputs/train/ae" / weights).read_bytes()


def test_an_experiment_recomposes_the_parameters(clone: Path):
    run(clone, "dvc", "exp", "run", "-S", "profile=smoke", "-S", "evaluate.bins=7", "evaluate")
    assert "bins: 7" in (clone / "params.yaml").read_text()
