"""The stage fits models to some demonstrations, calibrates on the others, and says whether its promise came true."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.demos import read_demos
from pipeline.artifacts.files import read_json, read_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool, write_scenes
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from studies.acceptance import stage as accept
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import labelled_demos, labelled_queries, pictured_scenes

TRAINING, SCENES, PATHS = 4, 5, 12
SMALL = ["profile=smoke", "workers=1", "scenes.per_seed=4", "train.steps=2", "path.steps=2"]
SMALL += ["accept.variants=[full,path]", "accept.fitted=1", "accept.level=0.1"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes with demonstrations, and new scenes with paths to be judged."""
    root = tmp_path_factory.mktemp("accept")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos"))])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    scenes = pictured_scenes(cfg, training | {"new_scenes": (SCENES, "train"), "new_items": (SCENES, "unseen")})
    labelled_demos(cfg, scenes)
    labelled_queries(cfg, scenes, ["new_scenes", "new_items"], PATHS)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    accept.main(cfg, directory)
    return directory


def cells(out: Path):
    for by_split in read_json(out / "metrics.json")["acceptance"].values():
        for by_rule in by_split.values():
            for rule, of_rule in by_rule.items():
                for cell in (of_rule, *of_rule["users"].values()):
                    yield rule, cell


def test_every_variant_split_rule_and_user_has_its_numbers(cfg: DictConfig, out: Path):
    found = read_json(out / "metrics.json")
    assert set(found["acceptance"]) == set(cfg.accept.variants)
    for by_split in found["acceptance"].values():
        assert set(by_split) == {"new_scenes", "new_items"}
        assert all(set(by_rule) == set(accept.RULES) for by_rule in by_split.values())
    for _, cell in cells(out):
        assert 0 <= cell["ci_low"] <= cell["mean"] <= cell["ci_high"] <= 1 and 0 <= cell["power"] <= 1
        assert cell["models"] in (2, 4) and cell["above"] + cell["abstained"] <= cell["models"]
    assert (found["labels"], found["held_out"]) == (36, {"split": 27, "crossed": 36})


def test_a_rule_that_accepts_nothing_has_accepted_nothing_invalid(out: Path):
    silent = [cell for _, cell in cells(out) if cell["abstained"] == cell["models"]]
    assert silent
    assert all(cell["mean"] == cell["power"] == cell["accepted"] == 0 for cell in silent)
    for _, cell in cells(out):
        rest = cell["models"] - cell["abstained"]
        assert (cell["where_any"] or 0.0) * rest == pytest.approx(cell["mean"] * cell["models"], abs=1e-5)


def test_who_knows_the_truth_keeps_the_promise(out: Path):
    for rule, cell in cells(out):
        assert rule != "truth" or cell["above"] == 0


def test_at_27_demonstrations_two_percent_are_never_promised(cfg: DictConfig, out: Path):
    curve = read_table(out / "curve.csv")
    strict = curve[(curve["rule"] == "split") & (curve["level"] <= 0.02)]
    assert len(strict) == 2 * 2 * 2 and (strict["abstained"] == 1).all() and (strict["power"] == 0).all()


def test_the_curve_goes_through_the_promise_and_never_turns_back(cfg: DictConfig, out: Path):
    curve, found = read_table(out / "curve.csv"), read_json(out / "metrics.json")["acceptance"]
    for (variant, split, rule), rows in curve.groupby(["variant", "split", "rule"]):  # pyright: ignore
        assert list(rows["level"]) == list(cfg.accept.levels)
        assert (np.diff(rows["power"]) >= 0).all()
        there = rows[rows["level"] == cfg.accept.level].iloc[0]
        assert there["power"] == pytest.approx(found[variant][split][rule]["power"], abs=2e-6)
        assert there["false"] == pytest.approx(found[variant][split][rule]["mean"], abs=2e-6)


def test_no_model_is_calibrated_in_a_scene_it_was_fitted_to(cfg: DictConfig):
    for seed in cfg.seeds:
        parts = accept._parts(cfg, seed)
        for form in ("split", "crossed"):
            for part in parts[form]:
                assert sorted([*part.fitted, *part.calibrating]) == list(range(TRAINING))
        assert sorted(np.concatenate([part.calibrating for part in parts["crossed"]])) == list(range(TRAINING))


def test_a_model_is_fitted_to_its_own_part_of_the_demonstrations_and_calibrated_on_the_rest(cfg: DictConfig):
    scenes, demos, seed = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos)), cfg.seeds[0]
    whole = accept._whole(cfg, scenes, demos, "normal", seed)
    for form, fitted in ((accept.SPLIT, cfg.accept.fitted), (accept.CROSSED, TRAINING - TRAINING // cfg.accept.folds)):
        for part in accept._parts(cfg, seed)[form]:
            training_set = accept._lesson(whole, part)
            assert len(training_set.images) == len(part.fitted) == fitted
            for own, all_of_them in zip(
                (training_set.images, training_set.z_theta, training_set.valid),
                (whole.images, whole.z_theta, whole.valid),
                strict=True,
            ):
                np.testing.assert_array_equal(own, all_of_them[part.fitted])
            calibrating = whole.images[part.calibrating]
            assert not (training_set.images[:, None] == calibrating).all((2, 3, 4)).any()


def test_a_second_run_by_two_processes_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == ["curve.csv", "metrics.json"]
    repeats_itself(accept.main, cfg, out, tmp_path, workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("variants", ["fulll"], "accept.variants is .*: expected some of full, ae, classifier, irl_maxent"),
        ("variants", [], "expected some of full"),
        ("level", 0.03, "accept.levels is .*: expected numbers with accept.level = 0.03 among them"),
        ("level", 1.0, "accept.level is 1.0: expected a number between 0 and 1"),
        ("levels", [0.2, 0.1], "expected ascending numbers"),
        ("fitted", 4, "accept.fitted is 4: expected a whole number from 1 to 3"),
        ("folds", 3, "accept.folds is 3: expected a whole number from 2 that divides scenes.per_seed = 4"),
        ("folds", 1, "accept.folds is 1"),
        ("error", 0, "accept.error is 0: expected a number between 0 and 1"),
    ],
)
def test_settings_out_of_range_are_refused_before_any_work(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(accept.main, cfg, f"accept.{name}", value, message, tmp_path / "out")


def test_other_training_scenes_than_asked_for_are_refused(cfg: DictConfig, tmp_path: Path):
    changed, scenes = cfg.copy(), read_scenes(Path(cfg.paths.scenes))
    changed.paths.scenes = str(tmp_path / "scenes")
    first = train_pool(cfg.seeds[0])
    few = SceneSet(
        scenes.images | {first: scenes.images[first][:3]},
        scenes.layouts | {first: scenes.layouts[first][:3]},
        scenes.appearances | {first: scenes.appearances[first][:3]},
    )
    write_scenes(tmp_path / "scenes", few)
    with pytest.raises(InputError, match=f"3 scenes {first}: expected 4; run the scenes stage again"):
        accept.main(changed, tmp_path / "out")
