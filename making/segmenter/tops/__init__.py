"""Families of procedural table tops. Whole families are held out of training, to judge it on kinds it never saw."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from making.segmenter.paint import Top
from making.segmenter.tops import cloth, generic, materials, patterns, prints, stone, wood

Kind = Literal["taught", "held_out"]


class Family(NamedTuple):
    """A kind of table top."""

    draw: Callable[[np.random.Generator, int], Top]  # draws a top of so many pixels a side
    kind: Kind


_KINDS: tuple[Kind, ...] = ("taught", "held_out")
_MODULES = (wood, stone, cloth, materials, patterns, prints, generic)  # each says which of its families are taught
FAMILIES: dict[str, Family] = {
    draw.__name__: Family(draw, kind)
    for module in _MODULES
    for kind, draws in zip(_KINDS, (module.TAUGHT, module.HELD_OUT), strict=True)
    for draw in draws
}


def family_names(kind: Kind) -> list[str]:
    """Return the names of the families of one kind."""
    return [name for name, family in FAMILIES.items() if family.kind == kind]
