"""Families of procedural table tops. Whole families are held out of training, to judge it on kinds it never saw."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from making.segmenter.paint import Top
from making.segmenter.tops import materials, prints

Kind = Literal["taught", "held_out"]
KINDS: tuple[Kind, Kind] = ("taught", "held_out")


class Family(NamedTuple):
    """A kind of table top."""

    draw: Callable[[np.random.Generator, int], Top]  # draws a top of so many pixels a side
    kind: Kind


FAMILIES: dict[str, Family] = {
    draw.__name__: Family(draw, kind)
    for group in (*materials.GROUPS, *prints.GROUPS)
    for kind, draws in zip(KINDS, group, strict=True)
    for draw in draws
}


def family_names(kind: Kind) -> list[str]:
    """Return the names of the families of one kind."""
    return [name for name, family in FAMILIES.items() if family.kind == kind]
