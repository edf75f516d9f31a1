"""The confounding study draws its worlds, fits models there, and asks them in ordinary scenes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_arrays
from pipeline.artifacts.scenes import train_pool
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from studies.confounding.stage import main
from tests.factories import labelled_demos, rendered_scenes, symbols_added
from tests.stages.facts import refuses

pytestmark = pytest.mark.slow
STUDY = "studies.confounding"
TRAINING, SCENES, PATHS = 4, 3, 8
SMALL = [
    "profile=smoke", "workers=1", "scenes.per_seed=4", "train.steps=2", "clearance.steps=2", f"{STUDY}.examples=2",
    f"~{STUDY}.variants.irl_ranked",
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
