"""The record stage shows what the stages before it wrote, the same each time."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import DEMO_COLUMNS, write_demos
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.models import model_dir
from pipeline.artifacts.scenes import SceneSet, layout_table, read_scenes, write_scenes
from pipeline.models.trained import build, load_model
from pipeline.stages.record import main
from pipeline.viewer.contents import ACCEPTED, CURVE_KEY, EFFECT_COLUMNS
from pipeline.viewer.scene import OUTCOME, p_classes
from pipeline.world.bezier import curve, lattice, random_z_theta
from pipeline.world.layout import SYMBOLS, add_item, random_layouts
from pipeline.world.rules import valid
from tests.factories import ITEMS, RULES, appearances, composed, random_demos, save_model
from tests.stages.facts import run_as_listed
from tests.viewer.example import read, read_maps

pytestmark = pytest.mark.slow

SCENES, STARTS, STEPS, SAMPLES = 4, 2, 5, 20


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[DictConfig, Path]:
    """The configuration of a run, and the folder of its inputs and recordings."""
    folder = tmp_path_factory.mktemp("shared")
    cfg = write_inputs(folder)
    run_as_listed(main, cfg, folder / "record")
    return cfg, folder


@pytest.fixture
def cfg(tmp_path: Path) -> DictConfig:
    """Inputs that a test may damage."""
    return write_inputs(tmp_path)


def write_inputs(tmp_path: Path) -> DictConfig:
    """Two variants of three users and one seed, untrained, on made-up scenes; aggressive has no repairs."""
    cfg = composed("profile=smoke", "seeds=[0]", "record.map_side=9", "record.training_scenes=3")
    cfg.variants = {variant: cfg.variants[variant] for variant in ("full", "classifier")}
    for stage in ("scenes", "demos", "train", "irl", "clearance", "evaluate", "repair", "intervene"):
        OmegaConf.update(cfg, f"paths.{stage}", str(tmp_path / stage))
    rng, pools = np.random.default_rng(0), ("train-s0", "new_items")
    images = {pool: rng.integers(0, 256, (SCENES, 100, 100, 3), dtype=np.uint8) for pool in pools}
    layouts = {pool: random_layouts(rng, SCENES, ITEMS, np.arange(4), RULES) for pool in pools}
    write_scenes(tmp_path / "scenes", SceneSet(images, layouts, dict.fromkeys(pools, appearances(SCENES))))
    levels = [list(cfg.variants), list(cfg.users), list(cfg.n_demos), [0], ["seen_scenes", "new_items"]]
    accuracy = pd.MultiIndex.from_product(levels, names=["variant", "user", "n_demos", "seed", "split"])
    scores = accuracy.to_frame(index=False).assign(accuracy=rng.random(len(accuracy)))
    write_table(tmp_path / "evaluate" / "accuracy.parquet", scores)

    demos = random_demos(rng, cfg, SCENES).assign(residual_m=0.0, poor_fit=False, duration_s=1.0, samples=SAMPLES)
    time = np.broadcast_to(np.linspace(0, 1, SAMPLES)[None, :, None], (len(demos), SAMPLES, 1))
    lines = curve(demos[["z_x", "z_y"]].to_numpy(), SAMPLES)
    samples = np.concatenate([time, lines, 0 * time], axis=-1).reshape(-1, 4)
    write_demos(tmp_path / "demos", demos[DEMO_COLUMNS], samples, SAMPLES * np.arange(len(demos) + 1))

    tables, paths = [], {}
    for variant, user in product(cfg.variants, cfg.users):
        count = 0 if user == "aggressive" else SCENES * STARTS
        scene, start = np.divmod(np.arange(count), STARTS)
        paths[f"{variant}-{user}-s0"] = random_z_theta(rng, count, STEPS + 1).astype(np.float32)
        row = {"method": "gradient", "variant": variant, "seed": 0, "user": user, "scene": scene, "start": start}
        tables.append(pd.DataFrame(row | {"valid_end": rng.random(count) < 0.5}))
    write_table(tmp_path / "repair" / "repairs.parquet", pd.concat(tables))
    write_arrays(tmp_path / "repair" / "paths.npz", paths)

    added = rng.integers(0, 256, (len(SYMBOLS), 1, SCENES, 100, 100, 3), dtype=np.uint8)
    more = [add_item(rng, layouts["new_items"], i, ITEMS, np.arange(4), RULES) for i in range(len(SYMBOLS))]
    tables = [layout_table(f"{symbol}-0", x) for symbol, x in zip(SYMBOLS, more, strict=True)]
    levels = [[f"add_{symbol}" for symbol in SYMBOLS], list(cfg.variants), list(cfg.users), [0], range(SCENES)]
    effects = pd.MultiIndex.from_product(levels, names=EFFECT_COLUMNS[:5]).to_frame(index=False)
    effects = effects.assign(effect=rng.uniform(-1, 1, len(effects)), true_effect=rng.uniform(-1, 1, len(effects)))
    write_arrays(tmp_path / "intervene" / "images.npz", {"images": added, "z_theta": random_z_theta(rng, SCENES, 2)})
    write_table(tmp_path / "intervene" / "layouts.parquet", pd.concat(tables, ignore_index=True))
    write_table(tmp_path / "intervene" / "effects.parquet", effects)

    for variant in cfg.variants:
        for seed, (user, n) in enumerate(product(cfg.users, cfg.n_demos)):
            save_model(cfg, variant, build(cfg.variants[variant], seed), user, 0, n)
        keys = pd.MultiIndex.from_product([[0], list(cfg.users), list(cfg.n_demos), [0, 10]], names=CURVE_KEY)
        curves = keys.to_frame(index=False)
        write_table(model_dir(cfg, variant) / "curves.parquet", curves.assign(total=rng.random(len(curves))))
    return cfg


def test_every_model_of_a_user_with_margins_has_a_recording_of_its_own_probabilities(
    recorded: tuple[DictConfig, Path],
) -> None:
    cfg, folder = recorded
    names = [f"{variant}-{user}-s0" for variant in cfg.variants for user in ("careful", "normal")]
    assert sorted(p.stem for p in (folder / "record" / "runs").iterdir()) == sorted([*names, "overview"])
    listed, scores = (read_table(folder / path) for path in ("record/recordings.csv", "evaluate/accuracy.parquet"))
    assert listed["run"].tolist() == [*names, "overview"]
    scores = scores[(scores["split"] == "new_items") & (scores["n_demos"] == 9) & (scores["user"] != "aggressive")]
    assert np.allclose(listed["accuracy"][:-1], scores["accuracy"], atol=1e-6)

    scenes, scene = read_scenes(folder / "scenes"), 1
    path = folder / "record" / "runs" / "full-careful-s0.rrd"
    model = load_model(cfg, "full", "careful", 0, cfg.main_n_demos)
    image, layout = scenes.images["new_items"][scene], scenes.layouts["new_items"][scene : scene + 1]
    entity = f"scene_{scene:03d}"

    z = dict(np.load(folder / "repair" / "paths.npz"))["full-careful-s0"].reshape(SCENES, STARTS, STEPS + 1, 2)
    p = np.array(read(path, f"p_valid/{entity}", "Scalars:scalars"))  # (step, start)
    expected = model.probability(image[None], z[scene].reshape(1, -1, 2)).reshape(STARTS, STEPS + 1)
    assert np.allclose(p.T, expected, atol=1e-6)

    cells = lattice(9)[None]
    predicted = model.probability(image[None], cells).reshape(9, 9)
    truth = valid(layout, cells, cfg.users["careful"]).reshape(9, 9)
    assert np.array_equal(read_maps(path, f"predicted/{entity}", 9)[0], p_classes(predicted))
    right = read_maps(path, f"outcomes/{entity}", 9)[0] <= OUTCOME + ACCEPTED
    assert np.array_equal(right, (predicted > 0.5) == truth)


def test_interventions_are_the_models_maps_and_the_stages_effects(recorded: tuple[DictConfig, Path]) -> None:
    cfg, folder = recorded
    path = folder / "record" / "runs" / "classifier-normal-s0.rrd"
    model = load_model(cfg, "classifier", "normal", 0, cfg.main_n_demos)
    images = dict(np.load(folder / "intervene" / "images.npz"))["images"][:, 0, 0]
    expected = model.probability(images, np.tile(lattice(9), (4, 1, 1))).reshape(4, 9, 9)
    shown = read_maps(path, "interventions/predicted", 9, "intervention")
    assert np.array_equal(shown, p_classes(expected))

    effects = read_table(folder / "intervene" / "effects.parquet")
    rows = effects[
        (effects["variant"] == "classifier") & (effects["user"] == "normal") & (effects["question"] == "add_glass")
    ]
    pages = [text for (text,) in read(path, "interventions/effects", "TextDocument:text", "intervention")]
    (page,) = [page for page in pages if page.startswith("## Glass added")]
    here, mean = rows[rows["scene"] == 0].iloc[0], rows[["effect", "true_effect"]].mean()
    assert "Question `add_glass`, normal user" in page
    assert f"model {here['effect']:+.2f}, truth {here['true_effect']:+.2f}." in page
    assert f"| **glass** | {mean['effect']:+.3f} | {mean['true_effect']:+.3f} |" in page


def test_recordings_of_removed_users_and_questions_are_gone_and_without_margins_every_user_has_some(cfg, tmp_path):
    effects = read_table(tmp_path / "intervene" / "effects.parquet")
    write_table(tmp_path / "intervene" / "effects.parquet", effects[effects["question"] != "add_bowl"])
    for removed in ([], ["careful", "normal"]):
        cfg.users = {user: margins for user, margins in cfg.users.items() if user not in removed}
        main(cfg, tmp_path / "record")
    listed = read_table(tmp_path / "record" / "recordings.csv")["run"]
    assert set(listed) == {"full-aggressive-s0", "classifier-aggressive-s0", "overview"}
    assert {path.stem for path in (tmp_path / "record" / "runs").iterdir()} == set(listed)
    path = tmp_path / "record" / "runs" / "full-aggressive-s0.rrd"
    pages = [text for (text,) in read(path, "interventions/effects", "TextDocument:text", "intervention")]
    assert [page.splitlines()[0] for page in pages] == ["## Plate added", "## Cutlery added", "## Glass added"]
