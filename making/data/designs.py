# ruff: noqa: E501  (the tables below read best a line an item)
"""All items and table tops of the world: appearance and size.

Training and validation items stand in the tables below; unseen ones are drawn at random (making.data.unseen). Unseen and
validation items share no pattern with the training items, no colour but white and steel, and with few exceptions no
outline: training bowls, plates and glasses are round or nearly round. They share the characteristics of their symbol: a
bowl's depth, a plate's well, a cutlery piece's slenderness, a glass's translucency.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from making.data.kitchenware import HALF_WIDTH, STEEL, bowl, cutlery, glass, plate
from making.data.shading import ROUND, Outline, cut, eared, oval, polygon, scalloped
from making.data.surface import surface
from making.data.unseen import SEED, Row, unseen_items, unseen_tops


@dataclass(frozen=True)
class Design:
    """One row of the catalogue and its drawing function; lengths in metres at scale 1."""

    name: str
    symbol: str
    split: str
    radius_m: float
    half_length_m: float
    draw: Callable[[], np.ndarray]

    @property
    def width_m(self) -> float:
        """Return the side of the cutout [m]."""
        return 2 * (self.radius_m + self.half_length_m)


WHITE, CREAM = (0.95, 0.95, 0.94), (0.93, 0.88, 0.77)  # RGB [1 = white]

# name, split, radius [m], inner, rim, accent, pattern, wall, outline (round unless given)
BOWLS = [
    ("bowl-white", "train", 0.0605, WHITE, WHITE, (0.20, 0.32, 0.58), "plain", 0.55),
    ("bowl-blue-band", "train", 0.0630, CREAM, (0.22, 0.36, 0.62), (0.22, 0.36, 0.62), "band", 0.50),
    ("bowl-terracotta", "train", 0.0660, (0.74, 0.42, 0.28), (0.62, 0.32, 0.20), (0.86, 0.60, 0.42), "rings", 0.58),
    ("bowl-sage", "train", 0.0680, (0.60, 0.70, 0.58), (0.50, 0.60, 0.48), (0.42, 0.50, 0.40), "speckles", 0.52),
    ("bowl-yellow-dots", "train", 0.0710, (0.92, 0.78, 0.36), (0.95, 0.90, 0.78), WHITE, "dots", 0.48),
    ("bowl-charcoal", "train", 0.0740, (0.27, 0.28, 0.31), (0.40, 0.41, 0.44), (0.16, 0.17, 0.19), "glaze", 0.56),
    ("bowl-mint", "validation", 0.0640, (0.62, 0.88, 0.78), (0.42, 0.72, 0.62), WHITE, "rays", 0.53, scalloped(6, 0.20)),
    ("bowl-navy-checks", "validation", 0.0520, (0.78, 0.80, 0.86), (0.14, 0.18, 0.36), (0.16, 0.22, 0.44), "checks", 0.59, oval(0.45)),
    ("bowl-coral", "validation", 0.0730, (0.94, 0.52, 0.42), (0.98, 0.80, 0.72), (0.98, 0.84, 0.76), "spiral", 0.49, polygon(8, 120.0)),
]  # fmt: skip

# name, split, radius [m], base, accent, pattern, well, outline
PLATES = [
    ("plate-white", "train", 0.068, WHITE, (0.30, 0.38, 0.55), "plain", 0.64),
    ("plate-blue-band", "train", 0.071, (0.95, 0.95, 0.95), (0.20, 0.34, 0.62), "band", 0.62),
    ("plate-green-rings", "train", 0.0745, (0.86, 0.90, 0.80), (0.40, 0.58, 0.36), "rings", 0.60),
    ("plate-sand", "train", 0.0775, (0.82, 0.74, 0.60), (0.52, 0.42, 0.30), "speckles", 0.66),
    ("plate-grey-dots", "train", 0.0805, (0.62, 0.65, 0.69), WHITE, "dots", 0.63),
    ("plate-rust", "train", 0.084, (0.66, 0.34, 0.22), (0.42, 0.20, 0.14), "glaze", 0.68),
    ("plate-aqua-checks", "validation", 0.0705, (0.90, 0.96, 0.98), (0.24, 0.60, 0.74), "checks", 0.63, polygon(6, 16.0)),
    ("plate-olive", "validation", 0.0570, (0.52, 0.54, 0.28), (0.78, 0.78, 0.52), "spiral", 0.64, oval(0.50)),
    ("plate-berry", "validation", 0.0830, (0.96, 0.90, 0.94), (0.56, 0.14, 0.34), "rays", 0.59, scalloped(10, 0.16)),
]  # fmt: skip

# name, split, length [m], kind, metal, handle, slimness of the handle
PIECES = [
    ("fork-steel", "train", 0.182, "fork", STEEL, None, 0.52),
    ("knife-steel", "train", 0.200, "knife", STEEL, None, 0.62),
    ("spoon-steel", "train", 0.178, "spoon", STEEL, None, 0.50),
    ("teaspoon-steel", "train", 0.162, "spoon", (0.66, 0.67, 0.70), None, 0.42),
    ("fork-black", "train", 0.190, "fork", STEEL, (0.16, 0.16, 0.18), 0.68),
    ("knife-wood", "train", 0.196, "knife", STEEL, (0.50, 0.32, 0.18), 0.74),
    ("fish-fork-copper", "validation", 0.180, "fish fork", (0.74, 0.48, 0.36), None, 0.50),
    ("server-green", "validation", 0.194, "server", STEEL, (0.18, 0.46, 0.28), 0.70),
    ("tongs-copper", "validation", 0.170, "tongs", (0.72, 0.50, 0.40), None, 0.95),
]  # fmt: skip

# name, split, radius [m], tint, body, foot, rim, outline, mouth (as wide as the outline unless given)
GLASSES = [
    ("tumbler-clear", "train", 0.0410, (0.92, 0.96, 0.97), 0.16, 0.66, 0.060),
    ("tumbler-thick", "train", 0.0430, (0.88, 0.93, 0.94), 0.20, 0.58, 0.095),
    ("tumbler-blue", "train", 0.0445, (0.62, 0.80, 0.94), 0.24, 0.62, 0.065),
    ("tumbler-green", "train", 0.0460, (0.66, 0.88, 0.72), 0.22, 0.70, 0.070),
    ("cut-glass", "train", 0.0475, (0.94, 0.96, 0.98), 0.18, 0.60, 0.075, cut(10)),
    ("beaker-smoke", "train", 0.0495, (0.62, 0.64, 0.66), 0.26, 0.64, 0.060),
    ("tumbler-teal", "validation", 0.0375, (0.52, 0.82, 0.82), 0.22, 0.65, 0.075, oval(0.30)),
    ("cut-glass-dozen", "validation", 0.0455, (0.93, 0.95, 0.94), 0.17, 0.57, 0.065, polygon(12, 160.0)),
    ("beaker-honey", "validation", 0.0415, (0.92, 0.84, 0.58), 0.23, 0.71, 0.055, eared(0.20, 1, 0.50)),
]  # fmt: skip

# name, split, kind, light, dark
SURFACES = [
    ("oak", "train", "wood", (0.74, 0.58, 0.40), (0.52, 0.36, 0.22)),
    ("walnut", "train", "wood", (0.46, 0.32, 0.22), (0.28, 0.19, 0.13)),
    ("birch", "train", "planks", (0.86, 0.78, 0.64), (0.70, 0.58, 0.42)),
    ("linen", "train", "linen", (0.82, 0.79, 0.72), (0.64, 0.60, 0.53)),
    ("granite", "train", "stone", (0.56, 0.57, 0.58), (0.34, 0.35, 0.37)),
    ("laminate", "train", "laminate", (0.58, 0.68, 0.68), (0.44, 0.54, 0.55)),
]  # fmt: skip


def designs() -> list[Design]:
    """Return all items in catalogue order: by symbol, training items first, then unseen and validation items."""
    tables = {"bowl": BOWLS, "plate": PLATES, "cutlery": PIECES, "glass": GLASSES}
    bowls, plates, pieces, glasses = (_with_unseen(symbol, table) for symbol, table in tables.items())
    return [
        *(_as_outlined("bowl", n, s, r, partial(bowl, i, *look)) for i, (n, s, r, *look) in enumerate(bowls)),
        *(_as_outlined("plate", n, s, r, partial(plate, i, *look)) for i, (n, s, r, *look) in enumerate(plates)),
        *(
            Design(n, "cutlery", s, HALF_WIDTH, round(look[0] / 2 - HALF_WIDTH, 4), partial(cutlery, i, *look))
            for i, (n, s, *look) in enumerate(pieces)
        ),
        *(_as_outlined("glass", n, s, r, partial(glass, *look)) for n, s, r, *look in glasses),
    ]


def _with_unseen(symbol: str, table: list[Row]) -> list[Row]:
    """Return the rows of a table with the unseen items after the training items."""
    training = [row for row in table if row[1] == "train"]
    return training + unseen_items(symbol, training) + table[len(training) :]


def _as_outlined(symbol: str, name: str, split: str, radius: float, draw: partial) -> Design:
    """Return a design whose footprint has the length of its outline."""
    outline = next((value for value in draw.args if isinstance(value, Outline)), ROUND)
    return Design(name, symbol, split, radius, round(radius * outline.stretch, 4), draw)


def surfaces() -> dict[str, tuple[str, Callable[[], np.ndarray]]]:
    """Return all table tops, name -> (split, drawing function)."""
    tops = {name: (split, partial(surface, i, *look)) for i, (name, split, *look) in enumerate(SURFACES)}
    for i, (name, split, *look) in enumerate(unseen_tops()):
        tops[name] = split, partial(surface, (i, SEED, 3), *look)
    return tops
