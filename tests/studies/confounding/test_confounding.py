"""The stage draws its world, fits models there, and asks them in the ordinary one, the same way twice."""

from pathlib import Path

import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_json, write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from studies.confounding import stage as confound
from studies.confounding.training_sets import draw_all
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import labelled_demos, pictured_scenes, symbols_added

TRAINING, SCENES, PATHS = 4, 3, 8
SMALL = ["profile=smoke", "workers=1", "scenes.per_seed=4", "train.steps=2", "path.steps=2", "confound.examples=2"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes with demonstrations, scenes of unseen items, and each symbol added to those."""
    root = tmp_path_factory.mktemp("confound")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos", "intervene"))])
    scenes = pictured_scenes(
        cfg, {train_pool(s): (TRAINING, "train") for s in cfg.seeds} | {"new_items": (SCENES, "unseen")}
    )
    labelled_demos(cfg, scenes)
    symbols_added(cfg, scenes, PATHS)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    confound.main(cfg, directory)
    return directory


def test_every_variant_user_and_symbol_is_judged_in_every_world(cfg: DictConfig, out: Path):
    found, users = read_json(out / "metrics.json"), set(cfg.confound.users)
    assert set(found["association"]) == {"ordinary", "confounded"}
    assert set(found["worlds"]) == set(cfg.confound.worlds)
    for variant, worlds in cfg.confound.variants.items():
        for world in worlds:
            judged = found["worlds"][world]
            assert judged["verdicts"][variant]["cells"] == len(users) * len(SYMBOLS)
            of = [judged[name][variant] for name in ("interventions", "confounding") if variant in judged[name]]
            assert len(of) == (2 if "control" in worlds and world != "control" else 1)
            assert all(set(by_user) == users and set(by_user["normal"]) == set(SYMBOLS) for by_user in of)
            assert all(set(x) == {"ordinary", "confounded", "control"} for x in judged["accuracy"][variant].values())
    for name in ("interventions", "verdicts", "confounding", "accuracy"):
        assert found[name] == found["worlds"]["confounded"][name]
    assert (found["seeds"], found["scenes"], found["paths"]) == (2, SCENES, PATHS)


def test_association_counts_every_demonstration(cfg: DictConfig, out: Path):
    for by_user in read_json(out / "metrics.json")["association"].values():
        for by_symbol in by_user.values():
            assert {cell["n_demos"] for cell in by_symbol.values()} == {len(cfg.seeds) * TRAINING * cfg.main_n_demos}


def test_in_truth_the_normal_user_minds_no_plate_in_any_world(out: Path):
    for judged in read_json(out / "metrics.json")["worlds"].values():
        for by_user in judged["interventions"].values():
            assert [by_user["normal"][s]["truth"] for s in ("bowl", "plate", "cutlery")] == [0, 0, 0]
            assert all(by_user["careful"][s]["truth"] <= 0 for s in SYMBOLS)


def test_what_the_cause_adds_is_the_difference_of_the_two_effects(out: Path):
    worlds = read_json(out / "metrics.json")["worlds"]
    for user, by_symbol in worlds["confounded"]["confounding"]["path"].items():
        for symbol, cell in by_symbol.items():
            here, there = (worlds[w]["interventions"]["path"][user][symbol] for w in ("confounded", "control"))
            assert cell["difference"] == pytest.approx(here["effect"] - there["effect"], abs=2e-6)
    assert worlds["control"]["confounding"] == {}


def test_examples_differ_between_the_worlds_only_in_what_stands_on_the_table(cfg: DictConfig, out: Path):
    examples = read_arrays(out / "examples.npz")
    assert {name: x.shape for name, x in examples.items()} == dict.fromkeys(cfg.confound.worlds, (2, 100, 100, 3))
    assert (examples["confounded"] == examples["control"]).all(-1).mean() > 0.6


def test_a_second_run_by_two_processes_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == ["examples.npz", "metrics.json"]
    repeats_itself(confound.main, cfg, out, tmp_path, workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("worlds.close.together", 1.5, "confound.worlds.close.together is 1.5: expected a chance"),
        ("worlds.control.together", 0.5, "confound.worlds.control.together is 0.5: expected 0"),
        ("worlds.close.gap_m", [0.001, 0.04], "expected two lengths from scenes.layout.clear_of_items = 0.015"),
        ("worlds", {}, "expected confounded and control among them"),
        ("glasses", 3, "confound.glasses is 3: expected a whole number from 1 to 2"),
        ("near_m", 0, "confound.near_m is 0"),
        ("users", ["carefull"], "expected some of careful, normal, aggressive"),
        ("variants", {"fulll": ["confounded"]}, "expected some of full, ae, classifier, irl_maxent, irl_ranked, path"),
        ("variants.path", ["control"], "expected confounded and others of"),
        ("examples", 0, "confound.examples is 0"),
    ],
)
def test_settings_out_of_range_are_refused_before_any_work(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(confound.main, cfg, f"confound.{name}", value, message, tmp_path / "out")


def test_a_seed_without_scenes_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    refuses(confound.main, cfg, "protocol.seeds", [0, 100], "no scenes train-s100", tmp_path / "out")


def test_tables_of_other_scenes_are_refused(cfg: DictConfig, tmp_path: Path):
    changed = cfg.copy()
    changed.paths.intervene = str(tmp_path)
    directory = Path(cfg.paths.intervene)
    arrays = read_arrays(directory / "images.npz")
    write_arrays(tmp_path / "images.npz", arrays | {"z_theta": arrays["z_theta"][1:]})
    (tmp_path / "layouts.parquet").write_bytes((directory / "layouts.parquet").read_bytes())
    with pytest.raises(InputError, match="run the intervene stage again"):
        confound.main(changed, tmp_path / "out")


def test_models_are_judged_in_scenes_of_the_pools_own_items(cfg: DictConfig):
    catalogue, scenes = read_catalogue(Path(cfg.paths.data)), read_scenes(Path(cfg.paths.scenes))
    for drawn in draw_all(cfg, confound._test_draws(cfg, scenes)):
        assert set(drawn.layouts.item[drawn.layouts.present]) <= set(catalogue.pool("unseen"))
