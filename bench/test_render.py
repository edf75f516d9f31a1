"""Compare rendering with compositing the same items by plain OpenCV calls at four times the size."""

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.params import compose
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import LayoutRules, Layouts, random_layouts
from pipeline.world.render import Palette, render_scenes

SCENES, SIDE = 50, 400  # number of scenes; side of the composited image [px]


@pytest.fixture(scope="module")
def world() -> tuple[Catalogue, Layouts]:
    catalogue = read_catalogue(Path("data"))
    rules = LayoutRules.of(compose().scenes.layout)
    rng = np.random.default_rng(0)
    return catalogue, random_layouts(rng, SCENES, catalogue.footprints, catalogue.pool("train"), rules)


def composite(catalogue: Catalogue, layouts: Layouts) -> np.ndarray:
    """Rotate, paste and shrink the items, without shadow, light, lens blur or noise."""
    images = []
    for scene in range(len(layouts)):
        table = cv2.resize(catalogue.surfaces[0], (SIDE, SIDE), interpolation=cv2.INTER_AREA).astype(np.float32)
        for slot in np.flatnonzero(layouts.present[scene]):
            item = layouts.item[scene, slot]
            cutout = catalogue.cutouts[item].astype(np.float32)
            cutout[..., :3] *= cutout[..., 3:] / 255
            width = catalogue.items["width_m"].iloc[item] * layouts.scale[scene, slot] * SIDE
            middle, (x, y) = len(cutout) / 2, layouts.centre[scene, slot] * SIDE
            turn = cv2.getRotationMatrix2D(
                (middle, middle), np.degrees(layouts.angle[scene, slot]), width / len(cutout)
            )
            turn[:, 2] += (x - middle, SIDE - y - middle)
            placed = cv2.warpAffine(cutout, turn, (SIDE, SIDE), flags=cv2.INTER_LINEAR)
            table = table * (1 - placed[..., 3:] / 255) + placed[..., :3]
        images.append(cv2.resize(table, (100, 100), interpolation=cv2.INTER_AREA))
    return np.rint(images).astype(np.uint8)


def test_render(benchmark, world: tuple[Catalogue, Layouts]):
    catalogue, layouts = world
    palette = Palette(catalogue)
    seeds, textures = range(SCENES), ["oak"] * SCENES
    benchmark(render_scenes, layouts, textures, seeds, palette)
    start = time.perf_counter()
    composite(catalogue, layouts)
    seconds_composite, seconds = time.perf_counter() - start, benchmark.stats.stats.median
    benchmark.extra_info["results"] = {
        "scenes_per_second": SCENES / seconds,
        "render_speedup_composite": seconds_composite / seconds,
    }
