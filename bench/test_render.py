"""Scenes rendered per second, against compositing the same items with Pillow at four times the size."""

import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.params import compose
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import LayoutRules, Layouts, random_layouts
from pipeline.world.render import Palette, render_scenes

SCENES, SIDE = 50, 400


@pytest.fixture(scope="module")
def world() -> tuple[Catalogue, Layouts]:
    catalogue = read_catalogue(Path("data"))
    rules = LayoutRules.of(compose().scenes.layout)
    rng = np.random.default_rng(0)
    return catalogue, random_layouts(rng, SCENES, catalogue.footprints, catalogue.pool("train"), rules)


def pillow(catalogue: Catalogue, layouts: Layouts) -> np.ndarray:
    """Turn, paste and shrink: no shadow, light, lens or noise."""
    pictures = []
    for scene in range(len(layouts)):
        table = Image.fromarray(catalogue.surfaces[0]).resize((SIDE, SIDE)).convert("RGBA")
        for slot in np.flatnonzero(layouts.present[scene]):
            item = layouts.item[scene, slot]
            side = max(1, int(catalogue.items["width_m"].iloc[item] * layouts.scale[scene, slot] * SIDE))
            turned = Image.fromarray(catalogue.cutouts[item]).resize((side, side))
            turned = turned.rotate(np.degrees(layouts.angle[scene, slot]), expand=True)
            x, y = layouts.centre[scene, slot] * SIDE
            table.alpha_composite(turned, (int(x - turned.width / 2), int(SIDE - y - turned.height / 2)))
        pictures.append(np.asarray(table.convert("RGB").resize((100, 100), Image.Resampling.BOX)))
    return np.stack(pictures)


def test_render(benchmark, world: tuple[Catalogue, Layouts]):
    catalogue, layouts = world
    palette = Palette(catalogue)
    seeds, textures = range(SCENES), ["oak"] * SCENES
    benchmark(render_scenes, layouts, textures, seeds, palette)
    start = time.perf_counter()
    pillow(catalogue, layouts)
    ours = benchmark.stats.stats.median
    theirs = time.perf_counter() - start
    benchmark.extra_info["results"] = {"scenes_per_second": SCENES / ours, "render_speedup_pillow": theirs / ours}
