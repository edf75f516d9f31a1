"""Learners read what they are said to read, and are judged by paths and scenes that they were not shown."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.models.baselines import NEAREST
from pipeline.params import compose
from pipeline.training.judged_sets import FEW, HELD_OUT, NEW, OWN, ROUTES, draw_judged_sets
from pipeline.world.layout import EMPTY, SYMBOLS, random_layouts
from pipeline.world.rules import clearance, slack
from studies.fairness.stage import MODEL, PERFECT, SEEN, draw_cases, main, true_code
from tests.factories import ITEMS, RULES, rendered_scenes

assert main  # of the fixture `out`
SMALL = ["profile=smoke", "workers=1", "train.steps=2", "readings.candidates=400"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes, new ones, and a prior that prefers no position."""
    cfg = compose([*SMALL, f"paths.scenes={tmp_path_factory.mktemp('fairness')}"])
    training = {train_pool(seed): (4, "train") for seed in cfg.seeds}
    rendered_scenes(cfg, training | {"val_scenes": (3, "train")})
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", {u: np.full((2, 2), 0.4) for u in cfg.evaluate.users})
    return cfg


def test_the_true_code_knows_each_item_and_nothing_of_empty_slots():
    layouts = random_layouts(np.random.default_rng(0), 40, ITEMS, np.arange(4), RULES)
    code = true_code(layouts, 3).reshape(40, 3, -1)
    present = layouts.present[:, :3]
    assert (code[~present] == 0).all() and (~present).any()
    np.testing.assert_array_equal(code[..., -len(SYMBOLS) :].argmax(-1)[present], layouts.symbol[:, :3][present])
    np.testing.assert_allclose(code[..., 0][present] * 0.7 + 0.5, layouts.centre[:, :3, 0][present])
    layouts.angle[:] += np.pi
    np.testing.assert_allclose(true_code(layouts, 3).reshape(code.shape), code, atol=1e-9)
    assert (layouts.symbol[:, 3:] == EMPTY).all()


def test_fewer_scenes_are_the_first_ones_and_judges_are_the_same_for_all(cfg: DictConfig):
    cases = draw_cases(cfg)
    for case in cases:
        same = [x for x in cases if (x.user, x.seed) == (case.user, case.seed)]
        largest = max(same, key=lambda x: (len(x.judged[OWN].valid), x.learner == case.learner))
        own, count = case.judged[OWN], len(case.judged[OWN].valid)
        assert len(own.scenes) == count
        np.testing.assert_array_equal(own.z_theta, largest.judged[OWN].z_theta[:count])
        for split in (SEEN, NEW):
            np.testing.assert_array_equal(case.judged[split].z_theta, largest.judged[split].z_theta)
            assert case.judged[split].valid.shape == (6, 5)
    of_model = [x.judged for x in cases if x.learner == MODEL]
    new = {judged[NEW].scenes.tobytes() for judged in of_model}
    assert len(new) == 1 and not new & {judged[SEEN].scenes.tobytes() for judged in of_model}


def test_labels_are_true_and_no_judged_path_was_shown(cfg: DictConfig):
    scenes, families = read_scenes(Path(cfg.paths.scenes)), np.array(cfg.readings.families)
    users = {user: cfg.users[user] for user in cfg.evaluate.users}
    shown = list(draw_judged_sets(cfg, scenes, ROUTES, cfg.studies.fairness.clear_cm, users))
    assert len(shown) == 2 * 2 * 2 * 2, "routes, distances, seeds, users"
    for x in shown:
        for split, (z, valid) in x.judged.items():
            layouts = scenes.layouts["val_scenes" if split == NEW else train_pool(x.seed)]
            np.testing.assert_array_equal(slack(layouts, clearance(layouts, z), cfg.users[x.user]) > 0, valid)
            if x.routes == FEW:
                far = np.linalg.norm(z[:, :, None] - families, axis=-1).min(-1)
                assert far.max() <= cfg.readings.family_radius + 1e-9
        demos, held_out = (x.judged[split][0] for split in (OWN, HELD_OUT))
        np.testing.assert_array_equal(x.z_theta, demos)
        assert np.linalg.norm(demos[:, :, None] - held_out[:, None], axis=-1).min() > 0


def test_every_learner_and_kind_is_judged_and_a_lead_is_over_the_nearest_demonstration(cfg: DictConfig, out: Path):
    study, scenes, kinds = cfg.studies.fairness, read_table(out / "scenes.csv"), read_table(out / "kinds.csv")
    fitted = scenes[scenes["learner"].isin([MODEL, PERFECT])].groupby("learner")["scenes"].unique()
    assert all(sorted(numbers) == list(study.scenes[learner]) for learner, numbers in fitted.items())
    assert scenes["accuracy"].between(0, 1).all() and kinds["accuracy"].between(0, 1).all()
    count = 2 * len(study.clear_cm)
    assert len(kinds) == count * (3 + 3 + 1), "three splits of the model and of position only, one of the nearest"
    assert (kinds.query(f"variant == '{NEAREST}'")[["lead", "lead_q1", "lead_q3"]] == 0).all(axis=None)
    held_out = kinds[kinds["split"] == HELD_OUT].pivot(index=["routes", "clear_cm"], columns="variant")
    lead = held_out["accuracy", MODEL] - held_out["accuracy", NEAREST]
    np.testing.assert_allclose(lead, held_out["lead", MODEL], atol=2e-6)
    examples = read_arrays(out / "examples.npz")
    assert len(examples["names"]) == count and examples["z_theta"].shape == (count, cfg.main_n_demos, 2)
