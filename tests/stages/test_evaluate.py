"""The evaluation scores what it is given, and refuses what is incomplete."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import Queries, write_queries
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.models import model_dir
from pipeline.runtime.errors import InputError
from pipeline.stages.evaluate import main
from pipeline.world.bezier import random_z_theta
from tests.factories import composed, random_demos, write_table_of_demos

pytestmark = pytest.mark.slow

SCENES, QUERIES = 3, 4


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds, two n_demos: `full` is right, `ae` wrong, `clearance` right at main_n_demos, others know nothing."""
    cfg, tmp_path = composed("profile=smoke"), tmp_path_factory.mktemp("evaluate")
    for stage in ("scenes", "demos", "train", "irl", "clearance"):
        OmegaConf.update(cfg, f"paths.{stage}", str(tmp_path / stage))
    rng = np.random.default_rng(0)
    pools = [*(f"train-s{seed}" for seed in cfg.seeds), "new_scenes", "new_items"]
    queries = {pool: _queries(rng, cfg) for pool in pools}
    write_queries(tmp_path / "demos", queries)
    write_table_of_demos(tmp_path / "demos", random_demos(rng, cfg, SCENES))
    layouts = pd.DataFrame({"pool": "new_items", "scene": range(SCENES), "item": range(SCENES), "symbol": 0})
    write_table(tmp_path / "scenes" / "layouts.parquet", layouts)
    write_arrays(tmp_path / "scenes" / "position_prior.npz", {u: rng.random((5, 5)) for u in cfg.users})
    for variant in cfg.variants:
        write_table(model_dir(cfg, variant) / "predictions.parquet", _predictions(cfg, variant, queries))
        fits = pd.DataFrame(product(cfg.seeds, cfg.users, cfg.n_demos), columns=["seed", "user", "n_demos"])
        ratio = 0.5 + fits["seed"] if cfg.variants[variant].get("alpha") else np.nan
        fits = fits.assign(reconstruction_over_flat=ratio, own_demonstrations=1.0, passed=fits["seed"] == 0)
        write_table(model_dir(cfg, variant) / "convergence.csv", fits)
    return cfg


def _queries(rng: np.random.Generator, cfg: DictConfig) -> Queries:
    valid = {user: rng.random((SCENES, QUERIES)) < 0.5 for user in cfg.users}
    valid["aggressive"][:] = True
    return Queries(random_z_theta(rng, SCENES, QUERIES), valid)


def _predictions(cfg: DictConfig, variant: str, queries: dict[str, Queries]) -> pd.DataFrame:
    scene, query = np.indices((SCENES, QUERIES)).reshape(2, -1)
    parts = []
    for seed, user, n, (split, pool) in product(cfg.seeds, cfg.users, cfg.n_demos, cfg.protocol.splits.items()):
        valid = queries[pool or f"train-s{seed}"].valid[user].ravel()
        known = {"full": valid, "ae": ~valid, "clearance": valid == (n == cfg.main_n_demos)}
        p = known.get(variant, np.full(valid.shape, 0.5)).astype(np.float32)
        part = pd.DataFrame({"scene": scene, "query": query, "p": p, "valid": valid})
        parts.append(part.assign(seed=seed, user=user, n_demos=n, split=split))
    return pd.concat(parts).sample(frac=1, random_state=0)  # the rows' order must not matter


def row(out: Path, table: str, **where: object) -> pd.Series:
    rows = read_table(out / f"{table}.csv")
    for name, value in where.items():
        rows = rows[rows[name] == value]
    assert len(rows) == 1
    return rows.iloc[0]


def test_a_right_model_scores_one_and_a_wrong_one_zero(cfg: DictConfig, out: Path):
    full = row(out, "accuracy", variant="full", split="new_items", n_demos=9)
    assert (full[["mean", "q1", "q3"]] == 1).all() and full["seeds"] == 2
    assert row(out, "accuracy", variant="ae", split="new_items", n_demos=1)["mean"] == 0
    assert (row(out, "scores", variant="full", split="seen_scenes")[["ece", "brier", "bias"]] == 0).all()
    wrong = row(out, "scores", variant="ae", split="seen_scenes")
    assert (wrong["ece"], wrong["brier"], wrong["auroc"]) == (1, 1, 0) and abs(wrong["bias"]) < 1
    assert row(out, "scores", variant="classifier", split="seen_scenes")["brier"] == 0.25


def test_the_tests_are_those_fixed_in_advance_corrected_for_their_number(out: Path):
    table = read_table(out / "comparisons.csv")
    assert dict(table.groupby("family").size()) == {
        "autoencoder": 4, "prior": 4, "irl": 6, "blind": 4, "few": 6, "clearance": 9,
    }  # fmt: skip
    assert not table.duplicated(["variant", "against", "split", "n_demos"]).any()
    assert (table["p_holm"] >= table["p"]).all()
    assert not table["significant"].any()  # two seeds cannot show anything
    compared = table.query("against == 'ae' and split == 'new_items'").iloc[0]
    assert compared["difference"] == 1 and compared["p"] == 0.5
    assert table["ci_low"].isna().all() and (table["verdict"] == "undecided").all()  # too few pairs


def test_other_predictions_are_named_and_nothing_is_written(cfg: DictConfig, tmp_path: Path):
    path = model_dir(cfg, "classifier") / "predictions.parquet"
    table = read_table(path)
    write_table(path, table.assign(valid=~table["valid"]))
    with pytest.raises(InputError, match="classifier lacks predictions, or has others, for user careful, 1 demonstr"):
        main(cfg, tmp_path / "out")
    assert not (tmp_path / "out").exists()
