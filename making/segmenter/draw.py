"""Draw the pool of pictures that the segmenter learns from.

python -m making.segmenter.draw --pool FOLDER --parts 44
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from making.segmenter import composites
from making.segmenter.composites import draw_composites, family_names
from making.segmenter.drawn import draw_scenes
from making.segmenter.pool import Part, pack, write_part
from pipeline.world import render

SEED = 31
DRAWN_SHARE = 0.35  # share of pictures from the drawn world; the others are composites on tops of the taught families


def draw(rng: np.random.Generator, n: int, data: str) -> list[Part]:
    """Draw `n` pictures of both kinds, with the catalogue in folder `data`."""
    drawn = round(DRAWN_SHARE * n)
    scenes = draw_scenes(rng, drawn, *render.read_palette(data))
    on_tops = draw_composites(rng, n - drawn, family_names("taught"), composites.read_palette(data))
    return [pack(scenes), pack(on_tops)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--parts", type=int, required=True)
    parser.add_argument("--data", default="data")
    arguments = parser.parse_args()
    arguments.pool.mkdir(parents=True, exist_ok=True)
    for part in range(arguments.parts):
        write_part(arguments.pool, part, partial(draw, data=arguments.data), SEED)
