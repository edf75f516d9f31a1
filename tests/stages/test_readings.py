"""The paper's curve in several readings: its mean is over the users it says."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.params import compose
from pipeline.stages.readings import COLUMNS, FIT, MODEL, RANDOM, _curve, main  # noqa: F401  # main: of the fixture `out`
from pipeline.training.judged_sets import HELD_OUT, OWN, POOLS, draw_judged_sets
from pipeline.world.rules import clearance, slack
from tests.factories import rendered_scenes

pytestmark = pytest.mark.slow

TRAINING, NEW_SCENES = 4, 3
SMALL = ["profile=smoke", "workers=1", "train.steps=2", "readings.candidates=400"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes, new ones, and made-up accuracies of stage evaluate."""
    folder = tmp_path_factory.mktemp("readings")
    cfg = compose([*SMALL, f"paths.scenes={folder / 'scenes'}", f"paths.evaluate={folder / 'evaluate'}"])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    new = {POOLS["new_scenes"]: (NEW_SCENES, "train"), POOLS["new_items"]: (NEW_SCENES, "validation")}
    rendered_scenes(cfg, training | new)
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", {user: np.full((2, 2), 0.4) for user in cfg.users})
    rows = pd.MultiIndex.from_product(
        [[MODEL, NEAREST, "ae"], ["seen_scenes", "new_items"], cfg.users, cfg.seeds, cfg.n_demos],
        names=["variant", "split", "user", "seed", "n_demos"],
    ).to_frame(index=False)
    accuracy = rows["user"].map({"careful": 0.5, "normal": 0.7, "aggressive": 1.0}) + 0.01 * rows["seed"]
    write_table(Path(cfg.paths.evaluate) / "accuracy.parquet", rows.assign(accuracy=accuracy))
    return cfg


def test_the_paper_s_mean_counts_the_user_to_whom_all_is_valid(cfg: DictConfig, out: Path):
    curve, table = read_table(out / "curve.csv"), read_table(out / "accuracy.parquet")
    assert list(curve.columns) == COLUMNS
    readings = [f"few_routes_{clear_cm}cm" for clear_cm in cfg.readings.clear_cm]
    assert set(curve["reading"]) == {RANDOM, *readings}
    held_out = curve.query("split == 'held_out'").set_index(["reading", "variant", "users", "n_demos"])["mean"]
    assert held_out[RANDOM, MODEL, "paper", 9] == pytest.approx((0.5 + 0.7 + 1.0) / 3 + 0.005, abs=1e-6)
    assert held_out[RANDOM, MODEL, "judged", 9] == pytest.approx(0.605, abs=1e-6)
    of_kind = table.query("split == 'held_out' and variant == 'full' and clear_cm == 4 and n_demos == 1")
    assert set(of_kind["user"]) == set(cfg.users)
    assert held_out[readings[0], MODEL, "paper", 1] == pytest.approx(of_kind["accuracy"].mean(), abs=1e-6)
    new = curve.query("split in ['new_scenes', 'new_items'] and reading != 'random_routes'")
    assert set(new["variant"]) == {MODEL, POSITION} and set(new["split"]) == {*POOLS}
    assert curve["ci_low"].isna().all()  # two seeds


def test_intervals_of_new_tables_take_the_scenes_as_chance_and_unseen_items_too():
    rng, items = np.random.default_rng(0), np.eye(4, dtype=int).repeat(5, axis=0)
    keys = pd.MultiIndex.from_product([["held_out", *POOLS], ["a", "b"], range(6)], names=["split", "user", "seed"])
    rows = keys.to_frame(index=False).assign(routes="few", clear_cm=4, n_demos=9, variant=MODEL)
    by_scene = 0.7 + items @ rng.normal(0, 0.1, 4) + rng.normal(0, 0.01, (len(rows), 20))
    few = rows.assign(by_scene=list(by_scene), accuracy=by_scene.mean(1))
    fits = few[[*FIT]].drop_duplicates().assign(passed=True)
    seen = rows.assign(accuracy=0.5)
    curve = _curve({"paper": ["a", "b"]}, few, fits, seen[seen["split"] == "new_items"], items)
    width = (curve["ci_high"] - curve["ci_low"]).groupby([curve["reading"], curve["split"]]).first()
    assert width["few_routes_4cm", "new_items"] > 1.5 * width["few_routes_4cm", "new_scenes"] > 0
    assert 0 < width["few_routes_4cm", "held_out"] < width["few_routes_4cm", "new_scenes"]
    assert curve.loc[curve["reading"] == RANDOM, "ci_low"].isna().all()


def test_labels_are_true_and_no_judged_path_was_shown(cfg: DictConfig):
    scenes, families = read_scenes(Path(cfg.paths.scenes)), np.array(cfg.readings.families)
    shown = list(draw_judged_sets(cfg, scenes))
    assert len(shown) == len(cfg.readings.clear_cm) * len(cfg.users) * len(cfg.protocol.seeds)
    for x in shown:
        for split, (z, valid) in x.judged.items():
            layouts = scenes.layouts[POOLS.get(split, train_pool(x.seed))]
            np.testing.assert_array_equal(slack(layouts, clearance(layouts, z), cfg.users[x.user]) > 0, valid)
            far = np.linalg.norm(z[:, :, None] - families, axis=-1).min(-1)
            assert far.max() <= cfg.readings.family_radius + 1e-9
        demos, held_out = (x.judged[split][0] for split in (OWN, HELD_OUT))
        np.testing.assert_array_equal(x.z_theta, demos)
        assert np.linalg.norm(demos[:, :, None] - held_out[:, None], axis=-1).min() > 0
