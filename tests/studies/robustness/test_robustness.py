"""The robustness stage asks the same models about the same paths where something is worse than in training."""

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, read_json, write_arrays
from pipeline.artifacts.scenes import SceneSet, read_scenes, write_scenes
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.registry import build
from pipeline.world.catalogue import read_catalogue
from studies.robustness import stage as robustness
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import (
    convinced,
    labelled_demos,
    labelled_queries,
    pictured_models,
    same_scenes_for_training,
    save_model,
)

SCENES, PATHS, VARIANTS = 3, 12, ("full", "path")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Untrained models of the paper's kind, and path models to which nothing matters: they accept every path."""
    folder = tmp_path_factory.mktemp("robustness")
    settings = [f"robustness.scenes={SCENES}", "robustness.mislabelled={path: [0.1, 0.2]}", "path.steps=2"]
    cfg = pictured_models(folder, VARIANTS, SCENES, *settings, f"paths.demos={folder / 'demos'}")
    OmegaConf.set_struct(cfg, False)
    del cfg.robustness.mislabelled.full
    for user, seed in product(cfg.users, cfg.protocol.seeds):
        model = build(cfg.variants.path, seed)
        assert isinstance(model, ClearanceModel)
        with torch.no_grad():
            model.weight.zero_()
            model.weight[:, 0] = -1e4
        convinced(model)
        save_model(cfg, "path", model, user, seed)
    scenes = same_scenes_for_training(cfg, "new_items")
    labelled_demos(cfg, scenes)
    labelled_queries(cfg, scenes, ["new_items"], PATHS)
    even = {user: np.random.default_rng(0).random((5, 5)) for user in cfg.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", even)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    robustness.main(cfg, directory)
    return directory


def test_every_variant_and_the_null_are_judged_at_every_strength(cfg: DictConfig, out: Path):
    found, r = read_json(out / "metrics.json"), cfg.robustness
    asked = dict(r.pictures) | {"tables": r.tables, "clutter": r.clutter, "labels": r.mislabelled.path}
    assert found["order"] == list(asked)
    for name, strengths in asked.items():
        assert [level["strength"] for level in found["disturbed"][name]] == list(strengths)
        for level in found["disturbed"][name]:
            assert set(level["models"]) == ({"path"} if name == "labels" else {*VARIANTS, "position_only"})
            assert all(set(cell["by_user"]) == set(cfg.evaluate.users) for cell in level["models"].values())


def test_a_worse_picture_changes_no_truth_and_a_fuller_table_makes_no_path_valid(out: Path):
    found = read_json(out / "metrics.json")
    shares = {name: [level["valid"] for level in levels] for name, levels in found["disturbed"].items()}
    as_is = found["undisturbed"]["valid"]
    assert all(set(of) == {as_is} for name, of in shares.items() if name != "clutter")
    assert [as_is, *shares["clutter"]] == sorted([as_is, *shares["clutter"]], reverse=True)
    assert shares["clutter"][-1] < as_is


def test_a_difference_is_what_the_disturbance_adds_to_the_accuracy(out: Path):
    found = read_json(out / "metrics.json")
    as_is = {model: cell["accuracy"]["mean"] for model, cell in found["undisturbed"]["models"].items()}
    for name, levels in found["disturbed"].items():
        cells = [(model, cell) for level in levels for model, cell in level["models"].items()]
        for model, cell in cells:
            assert cell["difference"] == pytest.approx(cell["accuracy"]["mean"] - as_is[model], abs=2e-6)
        assert name != "labels" or any(cell["difference"] for _, cell in cells)


def test_who_never_looks_is_as_right_whatever_the_picture(out: Path):
    found = read_json(out / "metrics.json")
    as_is = found["undisturbed"]["models"]
    pictured = [name for name in found["order"] if name not in ("clutter", "labels")]
    for level in (level for name in pictured for level in found["disturbed"][name]):
        for model in ("path", "position_only"):
            cell = level["models"][model]
            assert cell["accuracy"] == as_is[model]["accuracy"]
            assert (cell["difference"], cell["ci_low"], cell["ci_high"]) == (0, 0, 0)


def test_who_accepts_everything_is_right_about_the_valid_paths_and_no_other(out: Path):
    found = read_json(out / "metrics.json")
    for level in (found["undisturbed"], *found["disturbed"]["clutter"]):
        cell = level["models"]["path"]
        assert cell["accuracy"]["mean"] == pytest.approx(level["valid"], abs=2e-6)
        assert (cell["false_rejects"], cell["false_accepts"]) == (0, 1)


def test_one_scene_is_pictured_as_it_is_and_under_each_disturbance(cfg: DictConfig, out: Path):
    pictures = read_arrays(out / "examples.npz")
    assert list(pictures) == ["as_is", *cfg.robustness.pictures, "tables", "clutter"]
    assert len({picture.tobytes() for picture in pictures.values()}) == len(pictures)


def test_a_second_run_on_two_workers_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(robustness.main, cfg, out, tmp_path, workers=2)


def test_flipped_labels_are_others_for_each_user_and_seed_and_the_same_ones_at_a_larger_share(
    cfg: DictConfig, monkeypatch: pytest.MonkeyPatch
):
    taught = {}

    def kept(cfg, training_sets, images, z_theta, desc):
        taught.update(training_sets)
        return {variant: np.zeros((len(of), len(images), z_theta.shape[1])) for variant, of in training_sets.items()}

    monkeypatch.setattr(robustness, "refit_and_predict", kept)
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    robustness._mislabelled(cfg, scenes, np.zeros((1, 100, 100, 3), np.uint8), np.zeros((1, 2, 2)))
    flipped: dict[tuple[str, int], list[np.ndarray]] = {}
    for training_set in taught["path"]:
        _, labels = demo_arrays(demos, training_set.seed, training_set.user, cfg.main_n_demos)
        flipped.setdefault((training_set.user, training_set.seed), []).append((training_set.valid != labels).ravel())
    most = [of[-1] for of in flipped.values()]
    assert len(most) == len(cfg.evaluate.users) * len(cfg.protocol.seeds) > 1
    assert len({tuple(of) for of in most}) == len(most)
    assert all((small <= large).all() for of in flipped.values() for small, large in pairwise(of))


def test_a_picture_that_a_bad_camera_took_is_strange_and_one_as_in_training_seldom(out: Path):
    found = read_json(out / "metrics.json")
    levels = {name: level for name, of in found["disturbed"].items() for level in of[-1:]}
    assert "strange" not in levels["labels"]
    for level in (found["undisturbed"], *(of for name, of in levels.items() if name != "labels")):
        assert 0 <= level["strange"]["ci_low"] <= level["strange"]["mean"] <= level["strange"]["ci_high"] <= 1
        for variant, kept in level["kept"].items():
            assert kept["false_accepts"] <= level["models"][variant]["false_accepts"]
    assert levels["blur"]["strange"]["mean"] > found["undisturbed"]["strange"]["mean"]


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(robustness.main, cfg, "path", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "split",
            "seen_scenes",
            "robustness.split is 'seen_scenes': expected a split that all seeds share, one of new_scenes, new_items",
        ),
        ("scenes", 1, "robustness.scenes is 1: expected a whole number from 2"),
        ("scenes", SCENES + 1, f"robustness.scenes is {SCENES + 1}: expected at most {SCENES}, as new_items has"),
        ("pictures", {"fog": [0.1]}, r"robustness.pictures.\w+ is .*: expected none of that name"),
        ("pictures.shade", [0.5, 1.5], "expected numbers above 0, at most 1, the smallest first"),
        ("pictures.blur", [2, 1], "expected numbers above 0, the smallest first"),
        ("pictures.noise", [0.0], "expected numbers above 0, the smallest first"),
        ("tables", ["oak"], r"robustness.tables is \['oak'\]: expected some of marble, cherry, denim"),
        ("clutter", [1.5], "expected whole numbers above 0, the smallest first"),
        ("mislabelled", {"irl_ranked": [0.1]}, "robustness.mislabelled is .*: expected some of full, path"),
        ("mislabelled.path", [], "expected numbers above 0, at most 1, the smallest first"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(robustness.main, cfg, f"robustness.{name}", value, message, tmp_path / "out")


def test_a_disturbance_left_out_is_not_asked_about(cfg: DictConfig):
    without = cfg.copy()
    without.robustness.pictures.shade = None
    levels, _ = robustness._levels(without, read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data)))
    names = {level.disturbance for level in levels}
    assert "shade" not in names and "tint" in names


def test_a_pool_without_queries_is_named(cfg: DictConfig, tmp_path: Path):
    message = "no queries of careful, normal in new_scenes: run the demos stage again"
    scenes = read_scenes(Path(cfg.paths.scenes))
    changed = cfg.copy()
    changed.paths.scenes = str(tmp_path / "scenes")
    images, layouts, looks = (
        {**of, "new_scenes": of["new_items"]} for of in (scenes.images, scenes.layouts, scenes.appearances)
    )
    write_scenes(tmp_path / "scenes", SceneSet(images, layouts, looks))  # pyright: ignore[reportArgumentType]
    refuses(robustness.main, changed, "robustness.split", "new_scenes", message, tmp_path / "out")
