"""Composites of the drawn world: its training items on its training table tops, as the simulator renders them."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.world.catalogue import Catalogue
from pipeline.world.layout import SIDE, LayoutRules, Layouts, empty, random_layouts
from pipeline.world.render import SAMPLES, Palette, render_scenes
from pipeline.world.symbols import APPEARANCES

RULES = LayoutRules(  # as conf/scenes.yaml, but from empty tables to crowded ones, and items may touch
    items_per_scene=(0, 1, 2, 3, 4), glasses_chance=(0.2, 0.3, 0.3, 0.2), centre_low=0.05, centre_high=0.95,
    clear_of_ends=0.0, clear_of_items=0.0, scale_low=0.9, scale_high=1.1,
)  # fmt: skip
MIN_COVER = 0.25  # share of a pixel: handles are thinner than pixels
SOLID_ALPHA = 64  # alpha above which a cut-out counts as solid; what it encloses, such as a clear glass, does too


class DrawnScenes(NamedTuple):
    """Rendered scenes with the truth of each pixel."""

    images: UInt8[Array, "scene 100 100 3"]
    empty: UInt8[Array, "scene 100 100 3"]  # the same tables in the same light, without items
    instances: UInt8[Array, "scene 100 100"]  # 0: table; 1, 2, ...: items
    see_through: UInt8[Array, "scene 100 100"]  # 1: a transparent item


def draw_scenes(rng: np.random.Generator, n: int, catalogue: Catalogue, palette: Palette) -> DrawnScenes:
    """Draw `n` scenes with items and table tops of split `train`."""
    layouts = random_layouts(rng, n, catalogue.footprints, catalogue.pool("train"), RULES)
    textures, seeds = rng.choice(catalogue.texture_names("train"), n).tolist(), rng.integers(2**31, size=n).tolist()
    bare = render_scenes(empty(n, RULES.slots), textures, seeds, palette)
    images = render_scenes(layouts, textures, seeds, palette)
    instances, see_through = draw_instances(layouts, catalogue)
    return DrawnScenes(images, bare, instances, see_through)


def draw_instances(
    layouts: Layouts, catalogue: Catalogue
) -> tuple[UInt8[Array, "scene 100 100"], UInt8[Array, "scene 100 100"]]:
    """Return which item covers each pixel (0: none), and where that item is transparent."""
    instances = np.zeros((len(layouts), SIDE, SIDE), np.uint8)
    see_through = np.zeros_like(instances)
    for scene in range(len(layouts)):
        for slot in np.flatnonzero(layouts.present[scene]):
            covered = _solid(layouts, scene, int(slot), catalogue)
            instances[scene][covered] = slot + 1
            see_through[scene][covered] = APPEARANCES[layouts.symbol[scene, slot]].transparent
    return instances, see_through


def _solid(layouts: Layouts, scene: int, slot: int, catalogue: Catalogue) -> Array:
    """Return the pixels of which an item covers at least MIN_COVER."""
    item = int(layouts.item[scene, slot])
    cutout = catalogue.cutouts[item]
    outline = cv2.findContours(
        (cutout[..., 3] > SOLID_ALPHA).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    solid = cv2.drawContours(np.zeros(cutout.shape[:2], np.float32), outline[0], -1, 1, cv2.FILLED)
    width = catalogue.items["width_m"].iloc[item] * layouts.scale[scene, slot]
    c, s = np.cos(layouts.angle[scene, slot]), np.sin(layouts.angle[scene, slot])
    fine = SIDE * SAMPLES
    samples = np.array([[0, 0], [fine, 0], [0, fine]], np.float32)  # column and row of three samples
    place = np.stack([samples[:, 0] + 0.5, fine - samples[:, 1] - 0.5], -1) / fine - layouts.centre[scene, slot]  # [m]
    along = place @ [[c, -s], [s, c]] / width * [1, -1]  # from the cut-out's middle, to the right and down
    pixels = ((along + 0.5) * len(cutout) - 0.5).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    covered = cv2.warpAffine(solid, cv2.getAffineTransform(samples, pixels), (fine, fine), flags=flags)
    return cv2.resize(covered, (SIDE, SIDE), interpolation=cv2.INTER_AREA) > MIN_COVER
