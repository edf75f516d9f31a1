"""Draw the pool of composites that the segmenter learns from.

    python -m studies.perception.draw --pool FOLDER --parts 60
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.world.catalogue import Catalogue
from pipeline.world.render import Palette, read_palette
from studies.perception.drawn import draw_scenes
from studies.perception.pool import Part, pack, write_part

SEED = 31
DRAWN_SHARE = 0.2  # share of pictures from the drawn world; the others are composites on tops of many families


def draw(rng: np.random.Generator, n: int, catalogue: Catalogue, palette: Palette) -> list[Part]:
    """Draw `n` pictures of both kinds."""
    return [pack(draw_scenes(rng, n, catalogue, palette))]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--parts", type=int, required=True)
    parser.add_argument("--data", default="data")
    arguments = parser.parse_args()
    arguments.pool.mkdir(parents=True, exist_ok=True)
    for part in range(arguments.parts):
        write_part(arguments.pool, part, partial(draw, catalogue=read_palette(arguments.data)[0], palette=read_palette(arguments.data)[1]), SEED)
