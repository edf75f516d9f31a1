"""The evaluation scores what it is given, and refuses what is incomplete."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import Queries, demo_arrays, read_demos, read_queries, write_demos, write_queries
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.models import model_dir
from pipeline.models import baselines as nulls
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.stages import evaluate
from pipeline.stages.evaluate import main
from pipeline.stats.scores import accuracy
from pipeline.world.bezier import random_z_theta
from tests.stages.facts import refuses, repeats_itself

SCENES, QUERIES = 3, 8


@pytest.fixture
def cfg(tmp_path: Path) -> DictConfig:
    """Two seeds and two n; `full` is always right, `ae` always wrong, `path` right at main_n_demos, others know nothing."""
    cfg = compose(["profile=smoke"])
    for stage in ("scenes", "demos", "train", "irl", "path"):
        OmegaConf.update(cfg, f"paths.{stage}", str(tmp_path / stage))
    rng = np.random.default_rng(0)
    pools = [*(f"train-s{seed}" for seed in cfg.seeds), "new_scenes", "new_items"]
    queries = {pool: _queries(rng, cfg) for pool in pools}
    write_queries(tmp_path / "demos", queries)
    _write_demos(tmp_path / "demos", rng, cfg)
    write_arrays(tmp_path / "scenes" / "position_prior.npz", {u: rng.random((5, 5)) for u in cfg.users})
    for variant in cfg.variants:
        write_table(model_dir(cfg, variant) / "predictions.parquet", _predictions(cfg, variant, queries))
    return cfg


def _queries(rng: np.random.Generator, cfg: DictConfig) -> Queries:
    valid = {user: rng.random((SCENES, QUERIES)) < 0.5 for user in cfg.users}
    valid["aggressive"][:] = True
    return Queries(random_z_theta(rng, SCENES, QUERIES), valid)


def _write_demos(directory: Path, rng: np.random.Generator, cfg: DictConfig) -> None:
    index = pd.MultiIndex.from_product(
        [list(cfg.seeds), sorted(cfg.users), range(SCENES), range(10)], names=["seed", "user", "scene", "demo"]
    )
    demos = index.to_frame(index=False)
    z = random_z_theta(rng, len(demos))
    demos = demos.assign(z_x=z[:, 0], z_y=z[:, 1], valid=rng.random(len(demos)) < 0.5, residual_m=0.0)
    demos = demos.assign(poor_fit=False, duration_s=1.0, samples=0)
    write_demos(directory, demos, np.zeros((0, 4)), np.zeros(len(demos) + 1))


def _predictions(cfg: DictConfig, variant: str, queries: dict[str, Queries]) -> pd.DataFrame:
    scene, query = (x.ravel() for x in np.indices((SCENES, QUERIES)))
    parts = []
    for seed in cfg.seeds:
        for user in cfg.users:
            for n in cfg.n_demos:
                for split, pool in cfg.protocol.splits.items():
                    valid = queries[pool or f"train-s{seed}"].valid[user].ravel()
                    told = {"full": valid, "ae": ~valid, "path": valid == (n == cfg.main_n_demos)}
                    p = told.get(variant, np.full(valid.shape, 0.5))
                    parts.append(
                        pd.DataFrame({"scene": scene, "query": query, "p": p.astype(np.float32), "valid": valid})
                        .assign(seed=seed, user=user, n=n, split=split)
                    )  # fmt: skip
    return pd.concat(parts).sample(frac=1, random_state=0)  # the rows' order must not matter


def test_the_truth_scores_one_and_its_opposite_nothing(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["accuracy"]["full"]["new_items"]["n9"] == {"mean": 1, "q1": 1, "q3": 1, "seeds": 2}
    assert metrics["accuracy"]["ae"]["new_items"]["n1"]["mean"] == 0
    assert metrics["calibration"]["full"]["seen_scenes"] == {"ece": 0, "brier": 0, "bias": 0}
    of_ae = metrics["calibration"]["ae"]["seen_scenes"]
    assert (of_ae["ece"], of_ae["brier"]) == (1, 1) and abs(of_ae["bias"]) < 1
    assert metrics["calibration"]["classifier"]["seen_scenes"]["brier"] == 0.25


def test_every_cell_has_a_row_and_only_seen_scenes_have_a_nearest_demonstration(cfg, tmp_path):
    main(cfg, tmp_path / "out")
    scores = read_table(tmp_path / "out" / "accuracy.parquet")
    cells = len(cfg.users) * len(cfg.n_demos) * len(cfg.seeds)
    assert len(scores) == cells * (3 * (len(cfg.variants) + 1) + 1)
    assert set(scores[scores["variant"] == "nearest_demonstration"]["split"]) == {"seen_scenes"}
    assert (scores["count"] == SCENES * QUERIES).all()
    assert scores[scores["user"] == "aggressive"]["auroc"].isna().all()
    full = scores[(scores["variant"] == "full") & (scores["user"] != "aggressive")]
    assert (full["auroc"] == 1).all()


def test_the_nearest_demonstration_is_one_of_the_n_that_were_shown(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "out")
    scores = read_table(tmp_path / "out" / "accuracy.parquet")
    demos, queries = read_demos(Path(cfg.paths.demos)), read_queries(Path(cfg.paths.demos))
    for row in scores[scores["variant"] == "nearest_demonstration"].itertuples():
        asked = queries[f"train-s{row.seed}"]
        p = nulls.nearest_demonstration(*demo_arrays(demos, row.seed, row.user, row.n), asked.z)
        assert row.accuracy == accuracy(p.ravel(), asked.valid[row.user].ravel())


def test_other_scenes_count_in_an_interval_around_the_mean_and_errors_are_found_where_they_are(cfg, tmp_path):
    main(cfg, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    for variant, by_split in metrics["in_new_scenes"].items():
        for split, cell in by_split.items():
            assert cell["ci_low"] <= metrics["accuracy"][variant][split]["n9"]["mean"] <= cell["ci_high"]
    perfect, opposite = (metrics["in_new_scenes"][v]["new_items"] for v in ("full", "ae"))
    assert perfect["worst"] is None and opposite["worst"] == pytest.approx(opposite["few"] / SCENES)
    assert opposite["worst_by_chance"] == pytest.approx(opposite["worst"])  # where all is wrong, chance does as much
    null = metrics["in_new_scenes"]["position_only"]["new_items"]
    assert opposite["few"] / SCENES < null["worst_by_chance"] < 1
    assert set(metrics["in_new_scenes"]["position_only"]) == {"new_scenes", "new_items"}
    assert "nearest_demonstration" not in metrics["in_new_scenes"]


def test_users_are_averaged_as_configured(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    two = metrics["accuracy"]["position_only"]["new_items"]["n9"]["mean"]
    three = metrics["accuracy_all_users"]["position_only"]["new_items"]["n9"]["mean"]
    scores = read_table(tmp_path / "out" / "accuracy.parquet")
    rows = scores.query("variant == 'position_only' and split == 'new_items' and n == 9")
    by_user = rows.groupby("user")["accuracy"].mean()
    assert two == pytest.approx(by_user[["careful", "normal"]].mean())
    assert three == pytest.approx(by_user.mean())
    truth = read_queries(Path(cfg.paths.demos))["new_items"].valid
    share = np.mean([truth["careful"], truth["normal"]])
    assert metrics["calibration"]["classifier"]["new_items"]["bias"] == pytest.approx(0.5 - share)


def test_the_tests_are_those_fixed_in_advance_and_corrected_together(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "out")
    table = read_table(tmp_path / "out" / "comparisons.csv")
    assert dict(table.groupby("family").size()) == {"paper": 18, "path": 9}
    assert not table.duplicated(["variant", "against", "split", "n_demos"]).any()
    assert (table["p_holm"] >= table["p"]).all()
    assert not table["significant"].any()  # two seeds cannot show anything
    row = table.query("against == 'ae' and split == 'new_items'").iloc[0]
    assert row["difference"] == 1 and row["p"] == 0.5


def test_a_family_of_tests_leaves_the_others_as_they_are(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "both")
    cfg.evaluate.comparisons = [group for group in cfg.evaluate.comparisons if group.family == "paper"]
    main(cfg, tmp_path / "one")
    both, one = (read_table(tmp_path / name / "comparisons.csv") for name in ("both", "one"))
    pd.testing.assert_frame_equal(both[both["family"] == "paper"].reset_index(drop=True), one, check_dtype=False)


def test_of_ten_seeds_the_smallest_p_is_corrected_by_its_own_family_alone(cfg: DictConfig):
    """Nine tests of .00195 each stay significant; as one family of 27 they would not."""
    lifted = {"path": 0.1 + 0.01 * np.arange(10)}
    averaged = {
        (variant, split, n): lifted.get(variant, np.zeros(10))
        for variant in [*cfg.variants, "nearest_demonstration", "position_only", "path", "irl_maxent"]
        for split in cfg.protocol.splits
        for n in cfg.n_demos
    }
    table = evaluate._comparisons(cfg, averaged)
    path = table[table["family"] == "path"]
    assert len(path) == 9 and path["p_holm"].to_numpy() == pytest.approx(9 * 2 / 1024) and path["significant"].all()
    assert (table.loc[table["family"] == "paper", "p_holm"] == 1).all()


def test_the_same_inputs_give_the_same_bytes(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "a")
    repeats_itself(main, cfg, tmp_path / "a", tmp_path / "b")
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == ["accuracy.csv", "accuracy.parquet", "calibration.parquet", "comparisons.csv", "metrics.json"]


@pytest.mark.parametrize(
    ("drop", "message"),
    [
        ("seed == 1", "classifier has no predictions for user careful, n 1, seed 1"),
        ("user == 'normal' and n == 9", "no predictions for user normal, n 9, seed 0"),
        ("split == 'new_items'", "seed 0, split new_items"),
        ("scene == 2 and query == 7", "has 23 predictions for .* expected 24"),
    ],
)
def test_missing_predictions_are_named_and_nothing_is_written(cfg, tmp_path, drop: str, message: str):
    path = model_dir(cfg, "classifier") / "predictions.parquet"
    table = read_table(path)
    write_table(path, table.query(f"not ({drop})"))
    with pytest.raises(InputError, match=message):
        main(cfg, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_missing_variant_is_named(cfg: DictConfig, tmp_path: Path):
    (model_dir(cfg, "irl_ranked") / "predictions.parquet").unlink()
    with pytest.raises(InputError, match=r"irl_ranked/predictions\.parquet is missing"):
        main(cfg, tmp_path / "out")


def test_predictions_of_other_labels_are_refused(cfg: DictConfig, tmp_path: Path):
    path = model_dir(cfg, "full") / "predictions.parquet"
    table = read_table(path)
    write_table(path, table.assign(valid=~table["valid"]))
    with pytest.raises(InputError, match="full predicts other paths"):
        main(cfg, tmp_path / "out")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("evaluate.bins=0", "evaluate.bins is 0"),
        ("evaluate.users=[nobody]", "expected some of careful, normal, aggressive"),
        ("evaluate.comparisons.0.against=[irl]", "evaluate.comparisons is 'irl': expected one of full"),
        ("evaluate.comparisons.1.splits=[new_items]", "only in seen scenes"),
        ("evaluate.comparisons.3.family=paper", "27 tests in family paper"),
    ],
)
def test_what_cannot_be_compared_is_refused(cfg: DictConfig, tmp_path: Path, override: str, message: str):
    name, value = override.split("=")
    refuses(main, cfg, name, OmegaConf.from_dotlist([f"x={value}"]).x, message, tmp_path / "out")
