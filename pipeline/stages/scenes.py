"""Stage scenes: lay out and render every pool of scenes, and measure the true P(valid) of the world."""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array
from omegaconf import DictConfig
from pydantic import model_validator
from tqdm import tqdm

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import SceneSet, train_pool, write_scenes
from pipeline.launch import launch
from pipeline.runtime.settings import Count, Group, Several, Whole, need
from pipeline.runtime.streams import stream
from pipeline.world.bezier import lattice, random_z_theta
from pipeline.world.catalogue import random_scenes, read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, add_item, random_layouts
from pipeline.world.render import ImageSource, Palette, render_scenes
from pipeline.world.rules import PAPER_P_VALID, clearance, slack


class Settings(Group):
    root_seed: Whole
    per_seed: Count
    shared: Several
    validation: Count
    calibration: Count
    calibration_paths: Count
    prior_side: Count
    layout: LayoutRules
    source: ImageSource

    @model_validator(mode="after")
    def _agrees(self) -> "Settings":
        layout, name = self.layout, "scenes.layout"
        counts, room = layout.items_per_scene, layout.slots - 1
        fewer = f"whole numbers from 0 to {room}, one less than scenes.layout.slots"
        need(bool(counts) and max(counts) <= room, f"{name}.items_per_scene", counts, fewer)
        chances = layout.glasses_chance
        need(abs(sum(chances) - 1) < 1e-9, f"{name}.glasses_chance", chances, "chances that add up to 1")
        high = layout.centre_high
        need(layout.centre_low <= high, f"{name}.centre_high", high, "a place from centre_low to 1 [m]")
        need(layout.scale_low <= layout.scale_high, f"{name}.scale_high", layout.scale_high, "a size from scale_low")
        return self


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write images.npz, layouts.parquet, appearance.parquet, position_prior.npz, p_valid.csv and metrics.json."""
    catalogue = read_catalogue(Path(cfg.paths.data))
    rules = LayoutRules.of(cfg.scenes.layout)
    palette = Palette(catalogue, ImageSource.of(cfg.scenes.source))
    pools = {train_pool(seed): (cfg.scenes.per_seed, "train") for seed in [*cfg.seeds, *cfg.validation_seeds]}
    shared, validation = cfg.scenes.shared, cfg.scenes.validation
    pools |= {"new_scenes": (shared, "train"), "new_items": (shared, "unseen")}
    pools |= {"val_scenes": (validation, "train"), "val_items": (validation, "validation")}
    images, layouts, appearances = {}, {}, {}
    for pool, (count, split) in tqdm(pools.items(), desc="scenes"):
        layouts[pool], appearances[pool] = random_scenes(_generator(cfg, pool), count, catalogue, split, rules)
        textures, render_seeds = (appearances[pool][name].tolist() for name in ("texture", "render_seed"))
        images[pool] = render_scenes(layouts[pool], textures, render_seeds, palette)

    items, training = catalogue.footprints, catalogue.pool("train")
    bare = random_layouts(_generator(cfg, "calibration"), cfg.scenes.calibration, items, training, rules)
    rng = _generator(cfg, "interventions")
    worlds = {"none": bare}
    worlds |= {symbol: add_item(rng, bare, i, items, training, rules) for i, symbol in enumerate(SYMBOLS)}
    z = random_z_theta(rng, len(bare), cfg.scenes.calibration_paths)
    p_valid = _p_valid(cfg, worlds, z)
    known = p_valid["difference"].dropna().abs()
    side = cfg.scenes.prior_side
    on_lattice = _count_valid(cfg, bare, np.broadcast_to(lattice(side), (len(bare), side**2, 2)))
    prior = {user: (count / len(bare)).reshape(side, side) for user, count in on_lattice.items()}

    write_scenes(out_dir, SceneSet(images, layouts, appearances))
    write_arrays(out_dir / "position_prior.npz", prior)
    write_table(out_dir / "p_valid.csv", p_valid)
    write_json(out_dir / "metrics.json", {"world": {"largest_difference": known.max() if len(known) else None}})


def _generator(cfg: DictConfig, name: str) -> np.random.Generator:
    """Return a pool's own random stream, so that adding a pool changes no other."""
    return stream(cfg.scenes.root_seed, "scenes", name)


def _p_valid(cfg: DictConfig, worlds: dict[str, Layouts], z: Float[Array, "scene path 2"]) -> pd.DataFrame:
    """Return the true Table 2: P(valid) of the paths [m] to each user, without and with an added item."""
    rows = []
    for added, layouts in worlds.items():
        for user, count in _count_valid(cfg, layouts, z).items():
            truth = round(int(count.sum()) / (z.shape[0] * z.shape[1]), 4)
            rows.append((user, added, truth, PAPER_P_VALID.get(user, {}).get(added, np.nan)))
    table = pd.DataFrame(rows, columns=["user", "added", "truth", "paper"])
    table["difference"] = (table["truth"] - table["paper"]).round(4)
    return table.sort_values("user", kind="stable", key=lambda users: users.map(list(cfg.users).index))


def _count_valid(cfg: DictConfig, layouts: Layouts, z: Array) -> dict[str, Int[Array, " path"]]:
    """Return by user, for each column of `z`, the number of scenes in which that path [m] is truly valid."""
    clearances = clearance(layouts, z)
    return {user: (slack(layouts, clearances, margins) > 0).sum(0) for user, margins in cfg.users.items()}


if __name__ == "__main__":
    launch(main, "scenes")
