"""The stage fits few models to fewer and more scenes, and says where each model reaches the threshold."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_table
from pipeline.errors import InputError
from pipeline.params import compose
from pipeline.stages import demos, efficiency, scenes
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import SMALL_WORLD

OWN = 4
FEW = ["train.steps=2", "irl.copies=2", "path.steps=2", f"scenes.per_seed={OWN}", "efficiency.scenes=[2,4,5]"]
SCORES = {"path": {1: 0.94, 9: 0.97}, "irl_ranked": {1: 0.95, 9: 0.96}, "null_position": {1: 0.6, 9: 0.6}}


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes, demonstrations and queries, as the stages write them, and made-up scores of stage evaluate."""
    root = tmp_path_factory.mktemp("efficiency")
    cfg = compose([*SMALL_WORLD, *FEW, *(f"paths.{s}={root / s}" for s in ("scenes", "demos", "evaluate"))])
    for stage in (scenes, demos):
        stage.main(cfg, root / stage.__name__.rsplit(".", 1)[-1])
    keys = product([*cfg.variants, "null_position"], cfg.users, cfg.n, cfg.seeds, cfg.protocol.splits)
    rows = pd.DataFrame(keys, columns=["variant", "user", "n", "seed", "split"])
    accuracy = [SCORES.get(v, {}).get(n, 0.5) for v, n in zip(rows["variant"], rows["n"], strict=True)]
    accuracy = np.where(rows["split"] == "new_items", accuracy, 0.0)
    write_table(root / "evaluate" / "accuracy.parquet", rows.assign(accuracy=accuracy).sample(frac=1, random_state=0))
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    efficiency.main(cfg, directory)
    return directory


def test_fitted_variants_have_every_number_of_scenes_and_the_others_their_own(cfg: DictConfig, out: Path):
    found = read_json(out / "metrics.json")
    for variant in cfg.variants:
        sizes = {"s2", "s4", "s5"} if variant in cfg.efficiency.variants else {"s4"}
        assert set(found["accuracy"][variant]) == sizes
        for cell in found["accuracy"][variant].values():
            assert set(cell["users"]) == set(found["users"]) == set(cfg.evaluate.users)
            assert cell["q1"] <= cell["mean"] <= cell["q3"]
            assert cell["mean"] == pytest.approx(np.mean([c["mean"] for c in cell["users"].values()]), abs=1e-5)
    assert (found["null"]["mean"], found["seeds"]) == (0.6, 2)


def test_what_stage_evaluate_scored_is_taken_over(cfg: DictConfig, out: Path):
    curve = read_table(out / "curve.csv").set_index(["variant", "scenes", "n"])
    for variant, by_n in SCORES.items():
        for n, value in by_n.items():
            assert curve.loc[(variant, OWN, n), "mean"] == pytest.approx(value)
    assert (curve["demonstrations"] == curve.index.get_level_values(1) * curve.index.get_level_values(2)).all()
    assert len(curve) == 7 * 2 + len(cfg.efficiency.variants) * 2
    assert not curve.index.duplicated().any()


def test_the_least_n_and_scenes_at_the_threshold_are_named(out: Path):
    found = read_json(out / "metrics.json")
    assert found["threshold"] == 0.95
    assert found["reaches"]["path"] == {"scenes": OWN, "n": 9}
    assert found["reaches"]["irl_ranked"] == {"scenes": OWN, "n": 1}
    assert found["reaches"]["ae"] == {"scenes": None, "n": None}


def test_a_second_run_by_two_processes_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == ["curve.csv", "metrics.json"]
    repeats_itself(efficiency.main, cfg, out, tmp_path, workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("scenes", [], r"efficiency.scenes is \[\]: expected whole numbers from 1"),
        ("scenes", [0, 5], "efficiency.scenes"),
        ("scenes", [5, 5], "each once"),
        ("scenes", [2.5], "efficiency.scenes"),
        ("scenes", [OWN], "some of them other than scenes.per_seed = 4"),
        ("variants", ["fulll"], "expected some of full, ae, classifier, irl_maxent, irl_ranked, path"),
        ("variants", [], "efficiency.variants"),
        ("split", "seen_scenes", "expected a split that all seeds share, one of new_scenes, new_items"),
        ("threshold", 95, "efficiency.threshold is 95: expected a share"),
    ],
)
def test_settings_out_of_range_are_refused_before_any_work(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(efficiency.main, cfg, f"efficiency.{name}", value, message, tmp_path / "out")


def test_scenes_of_another_number_and_a_missing_score_are_refused(cfg: DictConfig, tmp_path: Path):
    changed = cfg.copy()
    changed.scenes.per_seed = OWN + 1
    with pytest.raises(InputError, match=r"train-s0 has not the 5 scenes of scenes\.per_seed"):
        efficiency.main(changed, tmp_path)
    scores = read_table(Path(cfg.paths.evaluate) / "accuracy.parquet")
    write_table(tmp_path / "evaluate" / "accuracy.parquet", scores[(scores["variant"] != "ae") | (scores["seed"] != 1)])
    changed = cfg.copy()
    changed.paths.evaluate = str(tmp_path / "evaluate")
    with pytest.raises(InputError, match="lacks the accuracy of variant ae, n 1, user careful, seed 1"):
        efficiency.main(changed, tmp_path / "out")
