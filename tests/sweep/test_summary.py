"""The summary of a sweep finds a difference that is there, and none that is not."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.artifacts.files import read_json, read_table, write_json, write_table
from pipeline.sweep.__main__ import _drop_clones, main

SEEDS = range(10)
PARAMETERS = {"protocol": {"name": "validation"}, "profile": "paper", "x": 7}
NOISE = np.random.default_rng(0).normal(0, 0.01, len(SEEDS))


def sweep_of(folder: Path, values: dict[Any, dict[str, list[float]]]) -> Path:
    """A finished sweep: beta, by default 0 -> headline -> its values by seed; and a job with beta 9 that failed."""
    jobs = [["profile=paper", f"beta={beta}"] for beta in [*values, 9]]
    for job, (beta, headlines) in zip(jobs, values.items(), strict=False):
        path = folder / "jobs" / job[1]
        rows = [(name, seed, value) for name, column in headlines.items() for seed, value in enumerate(column)]
        write_table(path / "results.parquet", pd.DataFrame(rows, columns=["headline", "seed", "value"]))
        (path / "params.yaml").write_text(yaml.safe_dump(PARAMETERS | {"beta": float(beta)}))
        write_json(path / "job.json", {"overrides": job, "state": "done"})
    write_json(folder / "jobs/beta=9/job.json", {"overrides": jobs[-1], "state": "failed", "error": "too <wide>"})
    record = {"commit": "0" * 40, "targets": ["evaluate"], "objective": None, "runs": [["beta=0,1,2,9", "x=[7]"]]}
    write_json(folder / "sweep.json", record | {"fixed": ["profile=paper"], "defaults": {"beta": "0"}, "jobs": jobs})
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sweep over beta: at 1 accuracy is 5 points better than at the default 0 and the error lower; at 2 as at 0."""
    values = {}
    for beta, accuracy, error in ((0, 0.80, 0.2), (1, 0.85, 0.1), (2, 0.80, 0.2)):
        noise = NOISE + np.random.default_rng(beta).normal(0, 0.002, len(SEEDS))
        values[beta] = {"accuracy.full.new_items": accuracy + noise, "effect_error.full": error + noise}
        values[beta] |= {"accuracy.clearance.new_items": 0.97 + NOISE}
    return sweep_of(tmp_path, values)


def test_the_better_setting_is_called_better_and_an_equal_one_is_not(folder: Path, capsys: pytest.CaptureFixture):
    assert main(["summary", str(folder)]) == 1  # a job failed
    assert "failed: beta=9: too <wide>" in capsys.readouterr().err
    table = read_table(folder / "differences.parquet").set_index(["headline", "setting"])
    assert {*table.index} == {
        (h, f"beta={b}") for h in ("accuracy.full.new_items", "effect_error.full") for b in (1, 2)
    }
    better = table.loc[("accuracy.full.new_items", "beta=1")]
    assert better["word"] == "better" and better["difference"] == pytest.approx(0.05, abs=0.003)
    assert better["ci_low"] < 0.05 < better["ci_high"] and better["p_holm"] < 0.001 and better["best"]
    assert table.loc[("accuracy.full.new_items", "beta=2"), "word"] in ("same", "undecided")
    assert table.loc[("effect_error.full", "beta=1"), "word"] == "better"  # lower is better
    results = read_table(folder / "results.parquet")
    assert list(results.columns) == ["setting", "beta", "headline", "seed", "value"]
    assert len(results) == 3 * 3 * len(SEEDS) and not results.duplicated(["setting", "headline", "seed"]).any()
    page = re.sub(r"\s+", " ", (folder / "index.html").read_text())
    assert "unseen items</th> <td>beta=1</td> <td>better</td>" in page
    assert "too &lt;wide&gt;" in page and "Clearance model" not in page  # what did not change is left out
    assert "--multirun beta=0,1,2,9 &#39;x=[7]&#39; --stages evaluate<" in page  # as a shell takes it
    assert "beta" in (folder / "figures/by-1.svg").read_text()


def test_a_parameter_that_only_a_later_run_sweeps_has_its_value_in_the_earlier_jobs_too(folder: Path):
    for beta, x in ((0, 7), (1, 7), (2, 8)):
        file = folder / "jobs" / f"beta={beta}" / "params.yaml"
        file.write_text(yaml.safe_dump(PARAMETERS | {"beta": beta, "x": x}))
    later = folder / "jobs" / "beta=2" / "job.json"
    write_json(later, read_json(later) | {"overrides": ["profile=paper", "beta=2", "x=8"]})
    assert main(["summary", str(folder)]) == 1
    assert {*read_table(folder / "results.parquet")["setting"]} == {"beta=0, x=7", "beta=1, x=7", "beta=2, x=8"}


@pytest.mark.parametrize(
    ("after", "word", "says"),
    [
        ([0.575, 0.675], "undecided", "too few pairs"),
        ([0.5 + 0.1 * seed + 0.075 for seed in range(8)], "undecided", "no variance"),
        ([0.1 + 0.4, 0.3 + 0.3], "same", "equal for every seed"),
    ],
)
def test_no_interval_no_p_and_no_better_without_six_pairs_that_vary(tmp_path: Path, after, word: str, says: str):
    before, name = [0.5 + 0.1 * seed for seed in range(len(after))], "accuracy.full.new_items"
    sweep_of(tmp_path, {0: {name: before}, 1: {name: after}, 2: {name: [0.1] * len(after)}})
    assert main(["summary", str(tmp_path)]) == 1
    row = read_table(tmp_path / "differences.parquet").set_index("setting").loc["beta=1"]
    assert row["word"] == word and row[["ci_low", "ci_high", "p_holm"]].isna().all()
    assert says in row["why"] and row["why"] in (tmp_path / "index.html").read_text()


def test_experiments_are_settings_of_their_own_and_a_later_run_leaves_the_default_the_reference(folder: Path):
    for beta, more in ((1, ["+experiment=one"]), (2, ["beta=0", "+experiment=two"])):
        file = folder / "jobs" / f"beta={beta}" / "params.yaml"
        file.write_text(yaml.safe_dump(PARAMETERS | {"beta": 0}))
        write_json(file.with_name("job.json"), {"overrides": ["profile=paper", *more], "state": "done"})
    assert main(["summary", str(folder)]) == 1
    table = read_table(folder / "results.parquet")
    assert {*table["setting"]} == {"experiment=null", "experiment=one", "experiment=two"}
    assert {*read_table(folder / "differences.parquet")["setting"]} == {"experiment=one", "experiment=two"}
    for beta, name in ((0, "beta"), (1, "latent"), (2, "latent")):  # those that sweep are no setting
        file = folder / "jobs" / f"beta={beta}" / "params.yaml"
        file.write_text(yaml.safe_dump(PARAMETERS | {"beta": beta}))
        write_json(file.with_name("job.json"), {"overrides": [f"+experiment={name}", f"beta={beta}"], "state": "done"})
    assert main(["summary", str(folder)]) == 1
    assert {*read_table(folder / "differences.parquet")["setting"]} == {"beta=1", "beta=2"}


def test_clones_of_jobs_that_may_still_run_stay(tmp_path: Path):
    host = socket.gethostname()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for name in (f"{host}-{ended.pid}", f"{host}-{os.getpid()}", f"node.{host}-{ended.pid}"):
        (tmp_path / name).mkdir()
    _drop_clones(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f"{host}-{os.getpid()}", f"node.{host}-{ended.pid}"}


def test_two_spellings_of_a_setting_count_once(tmp_path: Path):
    sweep_of(tmp_path, {1: {"unsafe": [0.5, 0.6]}, 100: {"unsafe": [0.5, 0.7]}, "1e2": {"unsafe": [0.5, 0.7]}})
    assert main(["summary", str(tmp_path)]) == 1
    assert len(read_table(tmp_path / "results.parquet")) == 4
