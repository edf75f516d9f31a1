"""Stage scenes: lay out and render every pool of scenes, and measure the true P(valid) of the world."""

from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from pydantic import model_validator
from tqdm import tqdm

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import SceneSet, train_pool, write_scenes
from pipeline.launch import launch
from pipeline.runtime.settings import (
    Chance,
    Count,
    Distance,
    Group,
    Place,
    Range,
    Several,
    ShareRange,
    Size,
    Spread,
    Whole,
    need,
    need_some,
)
from pipeline.runtime.streams import stream
from pipeline.world.bezier import lattice, random_z_theta
from pipeline.world.catalogue import Catalogue, random_scenes, read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, add_item, random_layouts
from pipeline.world.patterns import PATTERNS
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import PAPER_P_VALID, clearance, slack
from pipeline.world.source import ImageSource

CHUNK = 10  # scenes per batch of clearances, so that distances stay in the cache


class Layout(Group):
    items_per_scene: list[Whole]
    glasses_chance: list[Chance]
    centre_low: Place
    centre_high: Place
    clear_of_ends: Distance
    clear_of_items: Distance
    scale_low: Size
    scale_high: Size
    slots: Count


class Source(Group):
    exposure: Range
    white_balance: Spread
    fall_off: ShareRange
    vignette: ShareRange
    noise: ShareRange


class Settings(Group):
    root_seed: Whole
    per_seed: Count
    shared: Several
    validation: Count
    calibration: Count
    calibration_paths: Count
    prior_side: Count
    layout: Layout
    source: Source

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
        need_some("scenes.source.patterns", self.source.patterns, PATTERNS)
        return self


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write images.npz, layouts.parquet, appearance.parquet, position_prior.npz, p_valid.csv and metrics.json."""
    catalogue = read_catalogue(Path(cfg.paths.data))
    rules = LayoutRules.of(cfg.scenes.layout)
    palette = Palette(catalogue, ImageSource.of(cfg.scenes.source))
    images, layouts, appearances = {}, {}, {}
    for pool, (count, split) in tqdm(_pools(cfg).items(), desc="scenes"):
        layouts[pool], appearances[pool] = random_scenes(_generator(cfg, pool), count, catalogue, split, rules)
        textures, render_seeds = (appearances[pool][name].tolist() for name in ("texture", "render_seed"))
        images[pool] = render_scenes(layouts[pool], textures, render_seeds, palette)
    calibration = random_layouts(
        _generator(cfg, "calibration"), cfg.scenes.calibration, catalogue.footprints, catalogue.pool("train"), rules
    )
    prior = _position_prior(cfg, calibration)
    p_valid = _p_valid(cfg, calibration, catalogue, rules)
    known = p_valid["difference"].dropna().abs()
    write_scenes(out_dir, SceneSet(images, layouts, appearances))
    write_arrays(out_dir / "position_prior.npz", prior)
    write_table(out_dir / "p_valid.csv", p_valid)
    write_json(out_dir / "metrics.json", {"world": {"largest_difference": known.max() if len(known) else None}})


def _pools(cfg: DictConfig) -> dict[str, tuple[int, str]]:
    """Return each pool's number of scenes and the split of its items."""
    training = {train_pool(seed): (cfg.scenes.per_seed, "train") for seed in [*cfg.seeds, *cfg.validation_seeds]}
    return training | {
        "new_scenes": (cfg.scenes.shared, "train"),
        "new_items": (cfg.scenes.shared, "unseen"),
        "val_scenes": (cfg.scenes.validation, "train"),
        "val_items": (cfg.scenes.validation, "validation"),
    }


def _generator(cfg: DictConfig, name: str) -> np.random.Generator:
    """Return a pool's own random stream, so that adding a pool changes no other."""
    return stream(cfg.scenes.root_seed, "scenes", name)


def _position_prior(cfg: DictConfig, layouts: Layouts) -> dict[str, np.ndarray]:
    """Return each user's true mean validity over all scenes, in each cell of the z_theta lattice."""
    side = cfg.scenes.prior_side
    z = lattice(side)
    total = {user: np.zeros(len(z)) for user in cfg.users}
    for chunk in _chunks(layouts, "position prior"):
        clearances = clearance(chunk, np.broadcast_to(z, (len(chunk), *z.shape)))
        for user, margins in cfg.users.items():
            total[user] += (slack(chunk, clearances, margins) > 0).sum(0)
    return {user: (count / len(layouts)).reshape(side, side) for user, count in total.items()}


def _p_valid(cfg: DictConfig, layouts: Layouts, catalogue: Catalogue, rules: LayoutRules) -> pd.DataFrame:
    """Return the true Table 2: P(valid) of a random path, without and with an added item of each symbol."""
    rng = _generator(cfg, "interventions")
    worlds = {"none": layouts} | {
        symbol: add_item(rng, layouts, i, catalogue.footprints, catalogue.pool("train"), rules)
        for i, symbol in enumerate(SYMBOLS)
    }
    z = random_z_theta(rng, len(layouts), cfg.scenes.calibration_paths)
    rows = []
    for added, batch in worlds.items():
        counts = dict.fromkeys(cfg.users, 0)
        for i, chunk in enumerate(_chunks(batch, f"P(valid), {added}")):
            clearances = clearance(chunk, z[i * CHUNK : (i + 1) * CHUNK])
            for user, margins in cfg.users.items():
                counts[user] += int((slack(chunk, clearances, margins) > 0).sum())
        for user, count in counts.items():
            truth = round(count / (z.shape[0] * z.shape[1]), 4)
            rows.append((user, added, truth, PAPER_P_VALID.get(user, {}).get(added, np.nan)))
    table = pd.DataFrame(rows, columns=["user", "added", "truth", "paper"])
    table["difference"] = (table["truth"] - table["paper"]).round(4)
    return table.sort_values("user", kind="stable", key=lambda users: users.map(list(cfg.users).index))


def _chunks(layouts: Layouts, desc: str) -> list[Layouts]:
    starts = range(0, len(layouts), CHUNK)
    return [layouts[i : i + CHUNK] for i in tqdm(starts, desc=desc, leave=False)]


if __name__ == "__main__":
    launch(main, "scenes")
