"""The refute stage asks the same models other questions, whose true answer is nothing."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, read_json
from pipeline.artifacts.interventions import read_interventions
from pipeline.artifacts.scenes import read_scenes
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stages import intervene, refute
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, point_segment_distance
from pipeline.world.render import REACH_M
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import labelled_demos, pictured_models, same_scenes_for_training

SCENES, VARIANTS = 5, ("full", "path")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    folder = tmp_path_factory.mktemp("refute")
    settings = ["intervene.paths=40", "refute.scenes=4", "refute.permuted=[path]", f"paths.demos={folder / 'demos'}"]
    cfg = pictured_models(folder, VARIANTS, SCENES, *settings)
    intervene.main(cfg, Path(cfg.paths.intervene))
    labelled_demos(cfg, same_scenes_for_training(cfg, "new_items"))
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    refute.main(cfg, directory)
    return directory


def test_every_refuter_has_a_verdict_on_every_symbol_and_judged_user(cfg: DictConfig, out: Path):
    found, tops = read_json(out / "metrics.json"), read_catalogue(Path(cfg.paths.data)).texture_names("unseen")
    assert set(found["refuters"]["permuted"]) == {"path"}
    for name in ("untrained", "placebo", "mosaic", "far", *(f"other_table/{top}" for top in tops)):
        for variant in VARIANTS:
            assert set(found["refuters"][name][variant]) == set(cfg.evaluate.users)
            assert all(set(by_symbol) == set(SYMBOLS) for by_symbol in found["refuters"][name][variant].values())
            tally = found["tallies"][name][variant]
            assert tally["effect"] + tally["negligible"] + tally["undecided"] == tally["cells"] == 8
    assert set(found["placebo"]["path"]) == set(found["mosaic"]["path"]) == set(cfg.evaluate.users)
    assert found["halves"]["path"]["scenes"] == SCENES
    assert found["items"]["path"]["cells"] == 8 >= found["items"]["path"]["same"]
    assert found["items"]["path"]["items"] >= 2


def test_one_item_alone_of_a_symbol_is_refused(cfg: DictConfig):
    scenes = read_scenes(Path(cfg.paths.scenes))
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts["new_items"])
    added.layouts[1].item[:] = 7
    with pytest.raises(InputError, match=f"the same plate was added to all {SCENES} scenes: expected at least two"):
        refute._check_items(added)


def test_a_convinced_path_model_minds_a_mosaic_but_no_placebo_and_nothing_far_an_untrained_one_nothing(out: Path):
    """Whatever has an order and lies there is a thing to it."""
    found = read_json(out / "metrics.json")["refuters"]
    effect = {
        name: np.mean([cell["effect"] for by_symbol in found[name]["path"].values() for cell in by_symbol.values()])
        for name in ("untrained", "placebo", "mosaic", "far")
    }
    assert effect["mosaic"] < -0.02
    assert abs(effect["placebo"]) < 0.01
    assert abs(effect["untrained"]) < 1e-3
    assert abs(effect["far"]) < 0.5 * abs(effect["mosaic"])


def test_permuted_labels_are_the_same_ones_in_another_order_another_for_each_user_and_seed(
    cfg: DictConfig, monkeypatch: pytest.MonkeyPatch
):
    taught = {}

    def kept(cfg, training_sets, images, z_theta, desc):
        taught.update(training_sets)
        return {variant: np.zeros((len(of), len(images), z_theta.shape[1])) for variant, of in training_sets.items()}

    monkeypatch.setattr(refute, "refit_and_predict", kept)
    users, demos = list(cfg.evaluate.users), read_demos(Path(cfg.paths.demos))
    refute._permuted(cfg, users, np.zeros((1, 2, 100, 100, 3), np.uint8), np.zeros((2, 3, 2)))
    assert [(training_set.user, training_set.seed) for training_set in taught["path"]] == list(
        product(users, cfg.protocol.seeds)
    )
    orders = []
    for training_set in taught["path"]:
        z_theta, labels = demo_arrays(demos, training_set.seed, training_set.user, cfg.main_n_demos)
        np.testing.assert_array_equal(training_set.z_theta, z_theta)
        assert training_set.valid.sum() == labels.sum() and (training_set.valid != labels).any()
        orders.append(
            stream(cfg.refute.root_seed, "permuted", training_set.user, training_set.seed).permutation(labels.size)
        )
        np.testing.assert_array_equal(training_set.valid.ravel(), labels.ravel()[orders[-1]])
    assert len({tuple(order) for order in orders}) == len(orders)


def test_another_table_top_has_the_same_light_before_and_after_an_item_is_added(cfg: DictConfig):
    scenes, catalogue = read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data))
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts["new_items"])
    elsewhere = refute._elsewhere(cfg, scenes, "new_items", added)
    assert list(elsewhere) == catalogue.texture_names("unseen")
    centres = (np.arange(SIDE) + 0.5) / SIDE
    pixels = np.stack(np.broadcast_arrays(centres[None, :], 1 - centres[:, None]), -1)  # (row, column, 2) [m]
    for pictures in elsewhere.values():
        for before, after, placed in zip([pictures[0]] * 4, pictures[1:], added.placed, strict=True):
            ends = placed.ends[: cfg.refute.scenes, 0, :, None, None]
            away = point_segment_distance(pixels, ends[:, 0], ends[:, 1]) - placed.radius[: cfg.refute.scenes, :, None]
            change = np.abs(after.astype(int) - before)
            assert change[away > REACH_M].max() <= 1 < change.max()  # a shadow's last trace may turn a rounding


def test_another_table_that_is_the_same_changes_no_effect(cfg: DictConfig, monkeypatch, tmp_path: Path):
    def same(cfg, scenes, pool, added):
        few = slice(cfg.refute.scenes)
        return {"same": np.concatenate([scenes.images[pool][None, few], added.images[:, few]])}

    monkeypatch.setattr(refute, "_elsewhere", same)
    monkeypatch.setattr(refute, "_permuted", lambda *_: {})
    refute.main(cfg, tmp_path)
    found = read_json(tmp_path / "metrics.json")
    cells = [c for by_symbol in found["refuters"]["other_table/same"]["path"].values() for c in by_symbol.values()]
    assert all(cell["effect"] == 0 for cell in cells)
    assert all(effect < 0 for effect in found["items_alone"]["path"].values())


def test_items_meet_the_cells_of_their_own_symbol(monkeypatch):
    """Cells come by user and, within one, by the name of the symbol, items in the order of SYMBOLS."""
    met = []
    monkeypatch.setattr(refute, "stays_over_items", lambda effects, item: met.append(item) or np.ones(len(item), bool))
    item = np.arange(4 * 3).reshape(4, 3)
    refute._over_items(np.zeros((8, 2, 3)), item)
    for cell, of_cell in enumerate(met[0]):
        np.testing.assert_array_equal(of_cell, item[SYMBOLS.index(sorted(SYMBOLS)[cell % 4])])


def test_a_placebo_is_pictured_for_every_symbol_and_scene(out: Path):
    pictures = read_arrays(out / "placebos.npz")
    assert {name: of.shape for name, of in pictures.items()} == dict.fromkeys(
        ("placebo", "mosaic"), (len(SYMBOLS), 4, 100, 100, 3)
    )


def test_a_second_run_on_two_workers_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(refute.main, cfg, out, tmp_path, workers=2)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(refute.main, cfg, "path", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("scenes", 1, "refute.scenes is 1: expected a whole number from 2"),
        ("far_m", 0.04, "refute.far_m is 0.04: expected more than the widest margin in users, 0.045 m"),
        ("far_m", 1.4, "refute.far_m is 1.4: expected a length that paths of at least two scenes keep"),
        ("permuted", ["irl_ranked"], r"refute.permuted is \['irl_ranked'\]: expected some of full, path"),
        ("scenes", 2.5, "refute.scenes is 2.5"),
        ("tables", "glass", "refute.tables is 'glass': expected one of train, unseen"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(refute.main, cfg, f"refute.{name}", value, message, tmp_path / "out")
