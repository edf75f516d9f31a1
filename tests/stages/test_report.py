"""The report stage reads what the other stages wrote, and leaves a whole site and every headline."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, model_dir, save_weights, weights_path
from pipeline.artifacts.scenes import SceneSet, layout_table, train_pool, write_scenes
from pipeline.models.trained import build
from pipeline.report.render import PAGES
from pipeline.report.results import Results
from pipeline.runtime.errors import InputError
from pipeline.stages.report import HEADLINES, TABLES, main
from pipeline.world.layout import SYMBOLS, add_item
from tests.factories import composed, labelled_demos, labelled_queries
from tests.report import factory

pytestmark = pytest.mark.slow

VARIANTS = ("full", "clearance")
QUERIES = 5
METRICS = {
    "scenes": {"world": {"largest_difference": 0.01}},
    "evaluate": {"accuracy": {"full": {"new_items": 0.54}}},
    "readings": {"curve": {"random_routes": {"full": {"n1": 0.73}}}},
    "repair": {"repair": {"full": {"careful": 0.65}}},
    "intervene": {"verdicts_right": {"full": 3}},
}


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """The configuration of two variants whose inputs hold the factory's numbers and untrained models."""
    root = tmp_path_factory.mktemp("inputs")
    cfg = composed("profile=smoke", "report.map_side=6")
    OmegaConf.set_struct(cfg, False)
    for variant in set(cfg.variants) - set(VARIANTS):
        del cfg.variants[variant]
    for stage in (
        "scenes",
        "demos",
        "train",
        "irl",
        "clearance",
        "evaluate",
        "readings",
        "repair",
        "intervene",
        "record",
    ):
        cfg.paths[stage] = str(root / stage)
    results = factory.results(VARIANTS)
    write_inputs(root, cfg, results)
    return cfg


def write_inputs(root: Path, cfg: DictConfig, results: Results) -> None:
    """Write what every stage before the report leaves."""
    rng, layouts, scenes = np.random.default_rng(0), results.drawn.layouts, factory.SCENES
    pools = [*map(train_pool, cfg.protocol.seeds), "new_scenes", "new_items"]
    images = {pool: rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8) for pool in pools}
    appearance = pd.DataFrame({"texture": "oak", "render_seed": range(scenes)})
    drawn = SceneSet(images, {pool: layouts for pool in pools}, {pool: appearance for pool in pools})
    for name, (stage, file) in TABLES.items():
        write_table(root / stage / file, results.tables[name])
    keys = [(v, u, n, s, "new_items") for v in VARIANTS for u in cfg.users for n in (1, 9) for s in factory.SEEDS]
    by_seed = pd.DataFrame(keys, columns=["variant", "user", "n_demos", "seed", "split"]).assign(accuracy=0.5)
    write_table(root / "evaluate" / "accuracy.parquet", by_seed)
    write_scenes(root / "scenes", drawn)
    write_arrays(root / "scenes" / "position_prior.npz", {user: rng.random((5, 5)) for user in cfg.users})
    labelled_demos(cfg, drawn)
    labelled_queries(cfg, drawn, pools, QUERIES)
    write_arrays(root / "repair" / "paths.npz", dict(results.paths))
    items, unseen = results.catalogue.footprints, results.catalogue.pool("unseen")
    added = [
        layout_table(f"{o}-0", add_item(rng, layouts, i, items, unseen, factory.RULES)) for i, o in enumerate(SYMBOLS)
    ]
    write_table(root / "intervene" / "layouts.parquet", pd.concat(added))
    write_arrays(root / "intervene" / "images.npz", {"images": np.stack([images["new_items"][None]] * len(SYMBOLS))})
    for stage in HEADLINES:
        write_json(root / stage / "metrics.json", METRICS[stage])
    for variant, settings in cfg.variants.items():
        for user in cfg.users:
            path = weights_path(model_dir(cfg, variant), user, cfg.protocol.seeds[0], cfg.main_n_demos)
            save_weights(path, build(settings).state_dict())
        keys = pd.MultiIndex.from_product(
            [cfg.protocol.seeds, cfg.users, [cfg.main_n_demos], cfg.protocol.splits, range(scenes), range(QUERIES)],
            names=PREDICTION_COLUMNS[:-2],
        ).to_frame(index=False)
        predictions = keys.assign(p=rng.random(len(keys)), valid=True)
        write_table(model_dir(cfg, variant) / "predictions.parquet", predictions)


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("reports")
    main(cfg, out)
    return out


def test_the_site_is_whole_and_metrics_join_every_headline_with_the_claims(out: Path):
    assert {path.stem for path in out.glob("*.html")} == set(PAGES)
    assert (
        (out / "page.css").is_file() and list((out / "figures").glob("*.svg")) and list((out / "tables").glob("*.csv"))
    )
    metrics = json.loads((out / "metrics.json").read_text())
    assert set(metrics) == {"world", "accuracy", "curve", "repair", "verdicts_right", "claims"}
    assert set(metrics["claims"].values()) <= {"holds", "in a reading", "fails", "open", "untestable", "not tested"}
    assert "smoke run" in (out / "index.html").read_text()


def test_a_missing_input_is_named(cfg: DictConfig, tmp_path: Path):
    cfg = cfg.copy()
    cfg.paths.evaluate = str(tmp_path)
    with pytest.raises(InputError, match=r"accuracy\.csv is missing"):
        main(cfg, tmp_path / "out")
