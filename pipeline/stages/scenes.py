"""Stage scenes: lays out and renders every pool of scenes; measures the world's true P(valid)."""

import math
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from pipeline.artifacts.files import write_arrays, write_json
from pipeline.artifacts.scenes import SceneSet, train_pool, write_scenes
from pipeline.launch import launch
from pipeline.params import InputError
from pipeline.table.bezier import lattice, random_z_theta
from pipeline.table.items import Catalogue, read_catalogue
from pipeline.table.layout import SYMBOLS, LayoutRules, Layouts, add_item, random_layouts
from pipeline.table.render import Palette, render_scenes
from pipeline.table.rules import clearance, slack

PAPER_P_VALID = {  # Table 2 of the paper: the true world is calibrated to it
    "careful": {"none": 0.43, "bowl": 0.27, "plate": 0.28, "cutlery": 0.31, "glass": 0.30},
    "normal": {"none": 0.62, "bowl": 0.62, "plate": 0.63, "cutlery": 0.62, "glass": 0.48},
    "aggressive": {"none": 1.0, "bowl": 1.0, "plate": 1.0, "cutlery": 1.0, "glass": 1.0},
}
CHUNK = 10  # scenes judged at once: their distances stay in the cache


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write images, layouts, looks, position_prior.npz and metrics.json."""
    _check_settings(cfg)
    catalogue = read_catalogue(Path(cfg.paths.data))
    rules = LayoutRules.of(cfg.scenes.layout)
    palette = Palette(catalogue)
    images, layouts, looks = {}, {}, {}
    for pool, (count, split) in tqdm(_pools(cfg).items(), desc="scenes"):
        rng = _generator(cfg, pool)
        layouts[pool] = random_layouts(rng, count, catalogue.footprints, catalogue.pool(split), rules)
        textures = rng.choice(catalogue.texture_names("train"), count)
        looks[pool] = pd.DataFrame({"texture": textures, "render_seed": rng.integers(2**31, size=count)})
        images[pool] = render_scenes(layouts[pool], list(textures), looks[pool]["render_seed"].tolist(), palette)
    calibration = random_layouts(
        _generator(cfg, "calibration"),
        cfg.scenes.calibration,
        catalogue.footprints,
        catalogue.pool("train"),
        rules,
    )
    prior = _position_prior(cfg, calibration)
    metrics = _p_valid(cfg, calibration, catalogue, rules)
    write_scenes(out_dir, SceneSet(images, layouts, looks))
    write_arrays(out_dir / "position_prior.npz", prior)
    write_json(out_dir / "metrics.json", metrics)


def _check_settings(cfg: DictConfig) -> None:
    """Raise InputError before any work if a parameter is out of range."""
    scenes, layout = cfg.scenes, cfg.scenes.layout

    def need(holds: bool, name: str, expected: str) -> None:
        if not holds:
            raise InputError(f"parameter scenes.{name} is {OmegaConf.select(scenes, name)!r}: expected {expected}")

    def number(value: object, least: int | float, most: int | float = math.inf) -> bool:
        return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most

    def whole(value: object, least: int, most: int | float = math.inf) -> bool:
        return isinstance(value, int) and number(value, least, most)

    need(whole(scenes.generator, 0), "generator", "a whole number from 0")
    need(whole(layout.slots, 1), "layout.slots", "a whole number from 1")
    counts, room = layout.items_per_scene, layout.slots - 1
    some = OmegaConf.is_list(counts) and len(counts) > 0 and all(whole(count, 0, room) for count in counts)
    need(some, "layout.items_per_scene", f"a list of whole numbers from 0 to {room}, one less than scenes.layout.slots")
    chances = layout.glasses_chance
    sums = OmegaConf.is_list(chances) and all(number(chance, 0) for chance in chances) and abs(sum(chances) - 1) < 1e-9
    need(sums, "layout.glasses_chance", "a list of chances from 0 that add up to 1")
    for name in ("clear_of_ends", "clear_of_items"):
        need(number(layout[name], 0), f"layout.{name}", "a length from 0 [m]")
    need(number(layout.centre_low, 0, 1), "layout.centre_low", "a place from 0 to 1 [m]")
    need(number(layout.centre_high, layout.centre_low, 1), "layout.centre_high", "a place from centre_low to 1 [m]")
    need(number(layout.scale_low, 1e-9), "layout.scale_low", "a size above 0")
    need(number(layout.scale_high, layout.scale_low), "layout.scale_high", "a size from scale_low")


def _pools(cfg: DictConfig) -> dict[str, tuple[int, str]]:
    """Every pool: how many scenes, of which split's items."""
    own = {train_pool(seed): (cfg.scenes.per_seed, "train") for seed in [*cfg.seeds, *cfg.validation_seeds]}
    return own | {
        "new_scenes": (cfg.scenes.shared, "train"),
        "new_items": (cfg.scenes.shared, "unseen"),
        "val_scenes": (cfg.scenes.validation, "train"),
        "val_items": (cfg.scenes.validation, "validation"),
    }


def _generator(cfg: DictConfig, name: str) -> np.random.Generator:
    """A stream of its own for each pool, so that one more pool changes no other."""
    return np.random.default_rng([cfg.scenes.generator, zlib.crc32(name.encode())])


def _position_prior(cfg: DictConfig, layouts: Layouts) -> dict[str, np.ndarray]:
    """Per user the true mean validity of each cell of the z_theta lattice, whatever the scene."""
    side = cfg.scenes.prior_side
    z = lattice(side)
    total = {user: np.zeros(len(z)) for user in cfg.users}
    for chunk in _chunks(layouts, "position prior"):
        clear = clearance(chunk, np.broadcast_to(z, (len(chunk), *z.shape)))
        for user, margins in cfg.users.items():
            total[user] += (slack(chunk, clear, margins) > 0).sum(0)
    return {user: (count / len(layouts)).reshape(side, side) for user, count in total.items()}


def _p_valid(cfg: DictConfig, layouts: Layouts, catalogue: Catalogue, rules: LayoutRules) -> dict:
    """The true Table 2: P(valid) of a random path, without and with one more item of each symbol."""
    rng = _generator(cfg, "interventions")
    worlds = {"none": layouts} | {
        symbol: add_item(rng, layouts, i, catalogue.footprints, catalogue.pool("train"), rules)
        for i, symbol in enumerate(SYMBOLS)
    }
    z = random_z_theta(rng, len(layouts), cfg.scenes.calibration_paths)
    cells: dict[str, dict[str, dict[str, float | None]]] = {user: {} for user in cfg.users}
    for world, batch in worlds.items():
        valid = {user: 0 for user in cfg.users}
        for i, chunk in enumerate(_chunks(batch, f"P(valid), {world}")):
            clear = clearance(chunk, z[i * CHUNK : (i + 1) * CHUNK])
            for user, margins in cfg.users.items():
                valid[user] += int((slack(chunk, clear, margins) > 0).sum())
        for user, count in valid.items():
            truth, paper = count / (z.shape[0] * z.shape[1]), PAPER_P_VALID.get(user, {}).get(world)
            gap = None if paper is None else round(truth - paper, 4)
            cells[user][world] = {"truth": round(truth, 4), "paper": paper, "difference": gap}
    gaps = [abs(c["difference"]) for row in cells.values() for c in row.values() if c["difference"] is not None]
    return {
        "p_valid": cells,
        "largest_difference": max(gaps, default=None),
        "layouts": len(layouts),
        "paths": z.shape[1],
    }


def _chunks(layouts: Layouts, desc: str) -> list[Layouts]:
    starts = range(0, len(layouts), CHUNK)
    return [layouts[i : i + CHUNK] for i in tqdm(starts, desc=desc, leave=False)]


if __name__ == "__main__":
    launch(main, "scenes")
