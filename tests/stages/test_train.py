"""Facts about stage train: what it writes, that it repeats byte for byte, and what it refuses."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.models.base import untrained
from pipeline.models.trained import load_model
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import job_seed
from pipeline.stages.train import main
from pipeline.training.runner import _jobs
from pipeline.training.vae.engines import engine
from tests.stages.facts import run_as_listed

pytestmark = pytest.mark.slow

USERS = ("careful", "normal", "aggressive")
SMALL = ["seeds=[0,1]", "n_demos=[1,2]", "main_n_demos=2", "train.steps=4", "train.curve_every=2", "workers=1"]
SMALL += ["train.engine=simd", "checkpoints=[0,2,50]"]


def config(small_world: Path, out: Path, *overrides: str):
    paths = [f"paths.scenes={small_world}/scenes", f"paths.demos={small_world}/demos", f"paths.train={out}"]
    return compose([*paths, *SMALL, *overrides])


@pytest.fixture(scope="module")
def run(small_world, tmp_path_factory) -> Path:
    """One run of variant full."""
    out = tmp_path_factory.mktemp("train")
    run_as_listed(main, config(small_world, out), out / "full")
    return out


def test_a_user_without_invalid_demonstrations_gets_laplaces_constant(run):
    predictions = read_table(run / "full" / "predictions.parquet").query("user == 'aggressive' and n_demos == 2")
    np.testing.assert_allclose(predictions["p"], 7 / 8, rtol=1e-6)  # 3 scenes x 2 demonstrations, all valid


def test_saved_weights_give_the_predictions_that_were_written(run, small_world):
    cfg = config(small_world, run)
    scenes, queries = read_scenes(small_world / "scenes"), read_queries(small_world / "demos")
    predictions = read_table(run / "full" / "predictions.parquet")
    for split, pool in (("seen_scenes", "train-s1"), ("new_items", "new_items")):
        p = load_model(cfg, "full", "careful", 1, 2).probability(scenes.images[pool], queries[pool].z)
        rows = predictions.query(f"seed == 1 and user == 'careful' and n_demos == 2 and split == '{split}'")
        np.testing.assert_allclose(rows["p"].to_numpy().reshape(p.shape), p, rtol=1e-6)
        assert np.array_equal(rows["valid"].to_numpy().reshape(p.shape), queries[pool].valid["careful"])


def test_weights_on_the_way_are_kept_of_the_models_studied_that_learn(run, small_world):
    cfg = config(small_world, run)
    names = {f"{u}-s{s}-n2-step{step:05d}" for u in ("careful", "normal") for s in (0, 1) for step in (0, 2)}
    assert {path.stem for path in (run / "full" / "checkpoints").iterdir()} == names
    kept = load_model(cfg, "full", "careful", 1, 2, step=0)
    drawn = untrained(BetaVae, cfg.variants.full.model, job_seed(1, "careful", 2, "full"))
    assert isinstance(drawn, BetaVae)
    drawn.standardise(read_scenes(small_world / "scenes").images["train-s1"])
    for name, value in drawn.state_dict().items():
        assert torch.equal(kept.state_dict()[name], value)
    later = load_model(cfg, "full", "careful", 1, 2, step=2)
    assert not torch.equal(later.get_parameter("mean.weight"), kept.get_parameter("mean.weight"))


def test_neither_processes_nor_checkpoints_nor_other_seeds_change_a_weight(run, small_world, tmp_path):
    whole = _digests(run)
    main(config(small_world, tmp_path / "two", "workers=2"), tmp_path / "two" / "full")
    assert _digests(tmp_path / "two") == whole
    main(config(small_world, tmp_path, "checkpoints=[]", "seed=1"), tmp_path / "full")
    assert list((tmp_path / "full" / "checkpoints").iterdir()) == []
    alone = _digests(tmp_path / "full" / "weights")
    assert len(alone) == 6 and alone.items() <= _digests(run / "full" / "weights").items()


def test_convergence_is_what_the_saved_model_gives_on_its_own_training_set(run, small_world):
    table = read_table(run / "full" / "convergence.csv")
    assert len(table) == 12 and not table.duplicated(["seed", "user", "n_demos"]).any()
    images = read_scenes(small_world / "scenes").images["train-s1"]
    z, valid = demo_arrays(read_demos(small_world / "demos"), 1, "careful", 2)
    model = load_model(config(small_world, run), "full", "careful", 1, 2)
    row = table.query("seed == 1 and user == 'careful' and n_demos == 2").iloc[0]
    right = (model.probability(images, z) > 0.5) == valid
    assert row["own_demonstrations"] == pytest.approx(right.mean(), abs=1e-6)
    assert row["reconstruction_over_flat"] == pytest.approx(model.reconstruction_over_flat(images), rel=1e-5)
    expected = (table["own_demonstrations"] >= 0.995) & ~(table["reconstruction_over_flat"] >= 1)
    assert (table["passed"] == expected).all()
    assert table.loc[table["user"] == "aggressive", "reconstruction_over_flat"].isna().all()  # never trained


def test_a_variant_is_fitted_at_its_own_numbers_of_demonstrations(small_world, tmp_path):
    cfg = config(small_world, tmp_path, "n_demos=[1,2,5]", "variants.full.n_demos=[5,7]")
    assert {job.n_demos for job in _jobs(cfg, {}, BetaVae, lambda *data, seeds: [])} == {2, 5}  # 2: main_n_demos


@pytest.mark.parametrize("engine", ["reference", "cuda"])
def test_every_engine_learns_the_same_and_is_named(run, small_world, tmp_path, capsys, engine):
    main(config(small_world, tmp_path, f"train.engine={engine}"), tmp_path / "full")
    assert f"engine {engine} on " in capsys.readouterr().out
    ours, theirs = (read_table(root / "full" / "predictions.parquet") for root in (run, tmp_path))
    pd.testing.assert_frame_equal(ours.drop(columns="p"), theirs.drop(columns="p"))
    np.testing.assert_allclose(ours["p"], theirs["p"], atol=1e-3)  # 4 steps; later on rounding is amplified


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("variant=irl_ranked", "not fitted by stage train: expected one of full, ae, classifier"),
        ("seeds=[0,7]", "no scenes train-s7"),
    ],
)
def test_bad_input_ends_before_anything_is_written(small_world, tmp_path, override, message):
    with pytest.raises(ValueError, match=message):
        main(config(small_world, tmp_path, override), tmp_path / "full")
    assert not (tmp_path / "full").exists()


def test_without_numba_the_simd_engine_is_refused_and_auto_takes_the_reference(small_world, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.training.vae.engines.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs Numba.*train\.engine=reference"):
        main(config(small_world, tmp_path), tmp_path / "full")
    assert not (tmp_path / "full").exists()
    if not torch.cuda.is_available():
        assert engine("auto").name == "reference"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["n_demos=[9]", "main_n_demos=9"], "expected 9 in each scene"),
        (["train.rate=1e30"], r"full of careful, seed 0, n_demos 2: its loss is no longer finite at step \d+"),
    ],
)
def test_too_few_demonstrations_or_a_fit_that_diverges_is_no_result(small_world, tmp_path, overrides, message):
    with pytest.raises(InputError, match=message):
        main(config(small_world, tmp_path, *overrides), tmp_path / "full")
    assert not (tmp_path / "full").exists()


def _digests(root: Path) -> dict[str, str]:
    files = sorted(path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
