"""The path-traced training split as training pictures; its truth is footprints, so outlines are left open."""

from pathlib import Path

import numpy as np

from making.render.read import read_rendered
from making.segmenter.pool import Part, between
from pipeline.world.layout import SIDE, Layouts, point_segment_distance
from pipeline.world.symbols import APPEARANCES

INNER_SHARE, MIN_INNER_M = 0.6, 0.008  # within this share of a footprint's radius, at least this far, an item is sure
REACH_M = 0.025  # farther than this from every footprint, the table is sure: tall items lean out of their footprints


def read_path_traced(folder: Path) -> Part:
    """Return the pictures of a folder of `python -m making.render` as parts of the pool are."""
    tables = read_rendered(folder)
    truth = np.stack([_truth(tables.layouts, scene) for scene in range(len(tables.images))])
    return np.concatenate([tables.images, tables.empty, truth], -1)


def _truth(layouts: Layouts, scene: int) -> np.ndarray:
    """Return item, between, see-through and known of each pixel."""
    place = (np.arange(SIDE) + 0.5) / SIDE
    points = np.stack(np.meshgrid(place, 1 - place), -1)
    instances, see_through = np.zeros((2, SIDE, SIDE), np.uint8)
    inner, table = np.zeros((SIDE, SIDE), bool), np.ones((SIDE, SIDE), bool)
    for slot in np.flatnonzero(layouts.present[scene]):
        angle, centre = layouts.angle[scene, slot], layouts.centre[scene, slot]
        half = np.array([np.cos(angle), np.sin(angle)]) * layouts.half_length[scene, slot]
        distance, radius = point_segment_distance(points, centre - half, centre + half), layouts.radius[scene, slot]
        instances[distance < radius] = slot + 1
        see_through[distance < radius] = APPEARANCES[layouts.symbol[scene, slot]].transparent
        inner |= distance < max(INNER_SHARE * radius, MIN_INNER_M)
        table &= distance > radius + REACH_M
    return np.stack([instances > 0, between(instances), see_through, inner | table], -1).astype(np.uint8)
