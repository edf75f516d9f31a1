"""Families of procedural table tops. Whole families are held out of training, to judge it on kinds it never saw."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from studies.perception.tops import cloth, patterns, stone, wood
from studies.perception.tops.paint import Top


class Family(NamedTuple):
    """A kind of table top."""

    draw: Callable[[np.random.Generator, int], Top]  # draws a top of so many pixels a side
    kind: Literal["taught", "held_out"]


_TAUGHT = (
    (wood.straight_grain, wood.planks, wood.butcher_block, wood.cathedral_grain, wood.bamboo, wood.chipboard)
    + (wood.worn_paint, stone.marble, stone.granite, stone.concrete, stone.slate, stone.travertine, stone.cracked)
    + (stone.pebbles, cloth.plain_cloth, cloth.crumpled, cloth.striped_cloth, cloth.gingham, cloth.weave, cloth.twill)
    + (patterns.plain, patterns.gradient, patterns.clouds, patterns.camouflage, patterns.squares, patterns.stripes)
    + (patterns.zigzag, patterns.lattice, patterns.scattered_motifs, patterns.strokes, patterns.crossing_lines)
    + (patterns.mosaic, patterns.square_tiles, patterns.scales, patterns.polygons, patterns.rays, patterns.waves)
    + (patterns.labyrinth, patterns.leather, cloth.damask)
)
_HELD_OUT = (wood.herringbone, stone.terrazzo, stone.agate, cloth.tartan, cloth.knit, cloth.lace, patterns.hexagons) + (
    patterns.truchet,
    patterns.brushed_metal,
    patterns.newspaper,
    patterns.cork,
)
FAMILIES: dict[str, Family] = {
    draw.__name__: Family(draw, kind)
    for kind, draws in (("taught", _TAUGHT), ("held_out", _HELD_OUT))
    for draw in draws
}


def family_names(kind: Literal["taught", "held_out"]) -> list[str]:
    """Return the names of the families of one kind."""
    return [name for name, family in FAMILIES.items() if family.kind == kind]
