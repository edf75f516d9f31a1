"""The confounding study draws its worlds, fits models there, and asks them in ordinary scenes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from studies.confounding import stage as confounding
from studies.confounding.stage import main
from tests.factories import labelled_demos, rendered_scenes, symbols_added
from tests.stages.facts import refuses

pytestmark = pytest.mark.slow
STUDY = "studies.confounding"
TRAINING, SCENES, PATHS = 4, 3, 8
SMALL = [
    "profile=smoke", "workers=1", "scenes.per_seed=4", "train.steps=2", "clearance.steps=2", f"{STUDY}.examples=2",
    *(f"~{STUDY}.variants.{variant}" for variant in ("ae", "classifier", "irl_maxent", "irl_ranked")),
]  # fmt: skip


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes with demonstrations, scenes of unseen items, and each symbol added to those."""
    root = tmp_path_factory.mktemp("confounding")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos", "intervene"))])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    scenes = rendered_scenes(cfg, training | {"new_items": (SCENES, "unseen")})
    labelled_demos(cfg, scenes)
    symbols_added(cfg, scenes, PATHS)
    return cfg


@pytest.fixture
def effects(out: Path) -> pd.DataFrame:
    """One row a world, variant, user and symbol."""
    return read_table(out / "effects.csv").set_index(["world", "variant", "user", "symbol"])


def test_every_variant_answers_every_question_in_each_of_its_worlds(cfg: DictConfig, out: Path, effects):
    study = cfg.studies.confounding
    fitted = {(world, variant) for variant, worlds in study.variants.items() for world in worlds}
    assert set(effects.index) == {(*key, user, symbol) for key in fitted for user in study.users for symbol in SYMBOLS}
    accuracy = read_table(out / "accuracy.csv")
    assert set(accuracy[["world", "variant"]].itertuples(index=False, name=None)) == fitted
    assert set(accuracy["scenes"]) == {"ordinary", "confounded", "control"}
    assert (accuracy["majority"] >= 0.5).all()


def test_every_demonstration_of_every_world_counts_and_worlds_differ_in_their_items_alone(cfg: DictConfig, out: Path):
    table, examples, worlds = (
        read_table(out / "association.csv"),
        read_arrays(out / "examples.npz"),
        cfg.studies.confounding.worlds,
    )
    assert set(table["world"]) == {"ordinary", *worlds}
    assert len(table) == 4 * len(cfg.studies.confounding.users) * len(SYMBOLS)
    assert set(table["demonstrations"]) == {len(cfg.seeds) * TRAINING * cfg.main_n_demos}
    assert {name: x.shape for name, x in examples.items()} == dict.fromkeys(worlds, (2, 100, 100, 3))
    assert (examples["confounded"] == examples["control"]).all(-1).mean() > 0.6


def test_in_truth_the_normal_user_keeps_away_from_glasses_alone(effects):
    truth = effects["truth"]
    assert (truth.xs("normal", level="user").drop("glass", level="symbol") == 0).all()
    assert (truth.xs("careful", level="user") <= 0).all()


def test_the_shift_is_the_effect_less_that_of_the_control(effects):
    clearance = effects.xs("clearance", level="variant")
    difference = clearance.loc["confounded"]["effect"] - clearance.loc["control"]["effect"]
    np.testing.assert_allclose(clearance.loc["confounded"]["shift"], difference, atol=2e-5)
    without_control = effects.xs("full", level="variant")
    assert clearance.loc["control"]["shift"].isna().all() and without_control["shift"].isna().all()


def test_a_seed_without_scenes_and_items_added_to_other_scenes_are_refused(cfg: DictConfig, tmp_path: Path):
    refuses(main, cfg, "protocol.seeds", [0, 100], "no scenes train-s100", tmp_path / "out")
    changed, directory = cfg.copy(), Path(cfg.paths.intervene)
    changed.paths.intervene = str(tmp_path)
    arrays = read_arrays(directory / "images.npz")
    write_arrays(tmp_path / "images.npz", arrays | {"z_theta": arrays["z_theta"][1:]})
    (tmp_path / "layouts.parquet").write_bytes((directory / "layouts.parquet").read_bytes())
    with pytest.raises(InputError, match="rerun stage intervene"):
        main(changed, tmp_path / "out")


def test_models_are_judged_in_scenes_of_the_split_s_own_items(cfg: DictConfig):
    catalogue, scenes = read_catalogue(Path(cfg.paths.data)), read_scenes(Path(cfg.paths.scenes))
    layouts, images, z_theta = confounding.read_versions(cfg, scenes)
    assert len(layouts) == len(images) == len(confounding.VERSIONS) and len(z_theta) == SCENES
    for version in layouts:
        assert set(version.item[version.present]) <= set(catalogue.pool("unseen"))
