"""The pictures that the segmenter learns from: composites, scenes of the drawn world, and path-traced tables.

python -m making.segmenter.pool --pool FOLDER --parts 112

It draws a pool of the first two on disk, in parts that the training maps into memory as they appear.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from making.render.read import read_rendered
from making.segmenter import composites
from making.segmenter.composites import Composites, draw_composites, family_names
from pipeline.world import render
from pipeline.world.catalogue import Catalogue
from pipeline.world.layout import APPEARANCES, SIDE, LayoutRules, Layouts, empty, point_segment_distance, random_layouts

SEED = 31
PART = 500  # pictures in a part: 40 MB
DRAWN_SHARE = 0.35  # share of scenes of the drawn world; the others are composites on tops of the taught families
NEAR = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))  # two items within 2 pixels are too close to tell apart

# The drawn world: training items on training table tops, as the simulator renders them
RULES = LayoutRules(  # as conf/scenes.yaml, but from empty tables to crowded ones, and items may touch
    items_per_scene=(0, 1, 2, 3, 4), glasses_chance=(0.2, 0.3, 0.3, 0.2), centre_low=0.05, centre_high=0.95,
    clear_of_ends=0.0, clear_of_items=0.0, scale_low=0.9, scale_high=1.1,
)  # fmt: skip
MIN_COVER = 0.25  # share of a pixel: handles are thinner than pixels
SOLID_ALPHA = 64  # alpha above which a cut-out counts as solid; what it encloses, such as a clear glass, does too

# Path-traced tables: their truth is footprints, so outlines are left open
INNER_SHARE, MIN_INNER_M = 0.6, 0.008  # within this share of a footprint's radius, at least this far, an item is sure
REACH_M = 0.025  # farther than this from every footprint, the table is sure: tall items lean out of their footprints

Part = UInt8[Array, "picture 100 100 11"]  # channels: as named below
COLOURS, EMPTY = slice(3), slice(3, 6)  # of the picture, and of the empty table's
ITEM, BETWEEN, SEE_THROUGH = 6, 7, 8  # the truth, see `segmenter.Maps`
KNOWN = 9  # whether item and between are known there


def draw(rng: np.random.Generator, n: int, data: str) -> list[Part]:
    """Draw `n` pictures of both kinds, with the catalogue in folder `data`."""
    drawn = round(DRAWN_SHARE * n)
    scenes = draw_scenes(rng, drawn, *render.read_palette(data))
    on_tops = draw_composites(rng, n - drawn, family_names("taught"), composites.read_palette(data))
    return [pack(scenes), pack(on_tops)]


def pack(pictures: Composites) -> Part:
    """Return pictures as one array, with the truth that the segmenter learns: see `segmenter.MAPS`."""
    truth = [pictures.instances > 0, [between(i) for i in pictures.instances], pictures.see_through > 0]
    truth += [np.ones_like(truth[0]), pictures.look]
    return np.concatenate([pictures.images, pictures.empty, np.stack(truth, -1).astype(np.uint8)], -1)


def between(instances: UInt8[Array, "row column"]) -> UInt8[Array, "row column"]:
    """Return 1 near two items, which is where one must be cut from the other."""
    present = [(instances == i).astype(np.uint8) for i in range(1, instances.max() + 1)]
    count = sum((cv2.dilate(mask, NEAR) for mask in present), np.zeros_like(instances))
    return (count > 1).astype(np.uint8)


def part_file(folder: Path, part: int) -> Path:
    """Return the file of a part."""
    return folder / f"part-{part:04d}.npy"


def draw_scenes(rng: np.random.Generator, n: int, catalogue: Catalogue, palette: render.Palette) -> Composites:
    """Draw `n` scenes of the drawn world."""
    layouts = random_layouts(rng, n, catalogue.footprints, catalogue.pool("train"), RULES)
    textures, seeds = rng.choice(catalogue.texture_names("train"), n).tolist(), rng.integers(2**31, size=n).tolist()
    bare = render.render_scenes(empty(n, RULES.slots), textures, seeds, palette)
    images = render.render_scenes(layouts, textures, seeds, palette)
    instances, see_through, look = np.zeros((3, n, SIDE, SIDE), np.uint8)
    for scene, slot in np.argwhere(layouts.present):
        covered = _solid(layouts, scene, slot, catalogue)
        instances[scene][covered] = slot + 1
        see_through[scene][covered] = APPEARANCES[layouts.symbol[scene, slot]].transparent
        look[scene][covered] = 1 + layouts.symbol[scene, slot]
    return Composites(images, instances, bare, np.array(textures), see_through, look)


def _solid(layouts: Layouts, scene: int, slot: int, catalogue: Catalogue) -> Array:
    """Return the pixels of which an item covers at least MIN_COVER."""
    item = int(layouts.item[scene, slot])
    cutout = catalogue.cutouts[item]
    mask = (cutout[..., 3] > SOLID_ALPHA).astype(np.uint8)
    outline = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    solid = cv2.drawContours(np.zeros(cutout.shape[:2], np.float32), outline[0], -1, 1, cv2.FILLED)
    width = catalogue.items["width_m"].iloc[item] * layouts.scale[scene, slot]
    c, s = np.cos(layouts.angle[scene, slot]), np.sin(layouts.angle[scene, slot])
    fine = SIDE * render.SAMPLES
    samples = np.array([[0, 0], [fine, 0], [0, fine]], np.float32)  # column and row of three samples
    place = np.stack([samples[:, 0] + 0.5, fine - samples[:, 1] - 0.5], -1) / fine - layouts.centre[scene, slot]  # [m]
    along = place @ [[c, -s], [s, c]] / width * [1, -1]  # from the cut-out's middle, to the right and down
    pixels = ((along + 0.5) * len(cutout) - 0.5).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    covered = cv2.warpAffine(solid, cv2.getAffineTransform(samples, pixels), (fine, fine), flags=flags)
    return cv2.resize(covered, (SIDE, SIDE), interpolation=cv2.INTER_AREA) > MIN_COVER


def read_path_traced(folder: Path) -> Part:
    """Return the pictures of a folder of `python -m making.render` as parts of the pool are."""
    tables = read_rendered(folder)
    layouts, n = tables.layouts, len(tables.images)
    place = (np.arange(SIDE) + 0.5) / SIDE
    points = np.stack(np.meshgrid(place, 1 - place), -1)
    instances, see_through, look = np.zeros((3, n, SIDE, SIDE), np.uint8)
    inner, table = np.zeros(instances.shape, bool), np.ones(instances.shape, bool)
    for scene, slot in np.argwhere(layouts.present):
        angle, centre = layouts.angle[scene, slot], layouts.centre[scene, slot]
        half = np.array([np.cos(angle), np.sin(angle)]) * layouts.half_length[scene, slot]
        distance, radius = point_segment_distance(points, centre - half, centre + half), layouts.radius[scene, slot]
        covered = distance < radius
        instances[scene][covered] = slot + 1
        see_through[scene][covered] = APPEARANCES[layouts.symbol[scene, slot]].transparent
        look[scene][covered] = 1 + layouts.symbol[scene, slot]
        inner[scene] |= distance < max(INNER_SHARE * radius, MIN_INNER_M)
        table[scene] &= distance > radius + REACH_M
    pictures = pack(Composites(tables.images, instances, tables.empty, np.array(tables.tops), see_through, look))
    pictures[..., KNOWN] = inner | table
    return pictures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--parts", type=int, required=True)
    asked = parser.parse_args()
    asked.pool.mkdir(parents=True, exist_ok=True)
    for part in range(asked.parts):
        path = part_file(asked.pool, part)
        if not path.exists():  # a killed run goes on; each part has a random stream of its own
            partial = path.with_suffix(".partial.npy")
            np.save(partial, np.concatenate(draw(np.random.default_rng([SEED, part]), PART, "data")))
            partial.rename(path)
