"""Stage scenes: lays out and renders every pool of scenes; measures the world's true P(valid)."""

from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.files import write_arrays, write_json
from pipeline.artifacts.scenes import SceneSet, train_pool, write_scenes
from pipeline.launch import launch
from pipeline.runtime.streams import stream
from pipeline.world.bezier import lattice, random_z_theta
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, add_item, random_layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import clearance, slack

PAPER_P_VALID = {  # Table 2 of the paper: the true world is calibrated to it
    "careful": {"none": 0.43, "bowl": 0.27, "plate": 0.28, "cutlery": 0.31, "glass": 0.30},
    "normal": {"none": 0.62, "bowl": 0.62, "plate": 0.63, "cutlery": 0.62, "glass": 0.48},
    "aggressive": {"none": 1.0, "bowl": 1.0, "plate": 1.0, "cutlery": 1.0, "glass": 1.0},
}
CHUNK = 10  # scenes judged at once: their distances stay in the cache


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write images, layouts, looks, position_prior.npz and metrics.json."""
    catalogue = read_catalogue(Path(cfg.paths.data))
    rules = LayoutRules.of(cfg.scenes.layout)
    palette = Palette(catalogue)
    images, layouts, appearances = {}, {}, {}
    for pool, (count, split) in tqdm(_pools(cfg).items(), desc="scenes"):
        rng = _generator(cfg, pool)
        layouts[pool] = random_layouts(rng, count, catalogue.footprints, catalogue.pool(split), rules)
        textures = rng.choice(catalogue.texture_names("train"), count)
        appearances[pool] = pd.DataFrame({"texture": textures, "render_seed": rng.integers(2**31, size=count)})
        images[pool] = render_scenes(layouts[pool], list(textures), appearances[pool]["render_seed"].tolist(), palette)
    calibration = random_layouts(
        _generator(cfg, "calibration"),
        cfg.scenes.calibration,
        catalogue.footprints,
        catalogue.pool("train"),
        rules,
    )
    prior = _position_prior(cfg, calibration)
    metrics = _p_valid(cfg, calibration, catalogue, rules)
    write_scenes(out_dir, SceneSet(images, layouts, appearances))
    write_arrays(out_dir / "position_prior.npz", prior)
    write_json(out_dir / "metrics.json", metrics)


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
    return stream(cfg.scenes.root_seed, "scenes", name)


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
