# ruff: noqa: E501  (the tables below read best a line an item)
"""Every item and table top of the world: what it looks like and how large it is.

Unseen and validation items share neither colours nor patterns nor pieces with the training ones; what makes
a symbol (a bowl's depth, a plate's well, a piece's outline, translucency) they share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from drawing.crockery import bowl, plate
from drawing.cutlery import HALF_WIDTH, cutlery
from drawing.glass import glass
from drawing.surface import surface


@dataclass(frozen=True)
class Design:
    """One row of the catalogue and how to draw it; lengths in metres at scale 1."""

    name: str
    symbol: str
    split: str
    shape: str
    radius_m: float
    half_length_m: float
    draw: Callable[[], np.ndarray]

    @property
    def width_m(self) -> float:
        """What the cutout's side measures."""
        return 2 * (self.radius_m + self.half_length_m)


WHITE, CREAM, STEEL, GOLD = (0.95, 0.95, 0.94), (0.93, 0.88, 0.77), (0.72, 0.73, 0.75), (0.80, 0.66, 0.36)

# name, split, radius [m], inner, rim, accent, pattern, wall
BOWLS = [
    ("bowl-white", "train", 0.0605, WHITE, WHITE, (0.20, 0.32, 0.58), "plain", 0.55),
    ("bowl-blue-band", "train", 0.0630, CREAM, (0.22, 0.36, 0.62), (0.22, 0.36, 0.62), "band", 0.50),
    ("bowl-terracotta", "train", 0.0660, (0.74, 0.42, 0.28), (0.62, 0.32, 0.20), (0.86, 0.60, 0.42), "rings", 0.58),
    ("bowl-sage", "train", 0.0680, (0.60, 0.70, 0.58), (0.50, 0.60, 0.48), (0.42, 0.50, 0.40), "speckles", 0.52),
    ("bowl-yellow-dots", "train", 0.0710, (0.92, 0.78, 0.36), (0.95, 0.90, 0.78), WHITE, "dots", 0.48),
    ("bowl-charcoal", "train", 0.0740, (0.27, 0.28, 0.31), (0.40, 0.41, 0.44), (0.16, 0.17, 0.19), "glaze", 0.56),
    ("bowl-turquoise", "unseen", 0.0610, (0.26, 0.66, 0.68), (0.16, 0.50, 0.54), (0.62, 0.86, 0.84), "spiral", 0.60),
    ("bowl-red-checks", "unseen", 0.0640, (0.92, 0.86, 0.82), (0.74, 0.18, 0.17), (0.78, 0.24, 0.22), "checks", 0.46),
    ("bowl-plum", "unseen", 0.0665, (0.46, 0.26, 0.42), (0.36, 0.18, 0.32), (0.68, 0.48, 0.62), "petals", 0.54),
    ("bowl-celadon", "unseen", 0.0680, (0.70, 0.84, 0.74), (0.62, 0.76, 0.66), (0.40, 0.58, 0.50), "rays", 0.62),
    ("bowl-ochre", "unseen", 0.0710, (0.74, 0.54, 0.20), (0.34, 0.24, 0.16), (0.44, 0.28, 0.12), "spiral", 0.50),
    ("bowl-pink-petals", "unseen", 0.0735, (0.94, 0.74, 0.76), (0.90, 0.62, 0.66), (0.72, 0.32, 0.42), "petals", 0.57),
    ("bowl-mint", "validation", 0.0620, (0.62, 0.88, 0.78), (0.42, 0.72, 0.62), WHITE, "rays", 0.53),
    ("bowl-navy-checks", "validation", 0.0675, (0.78, 0.80, 0.86), (0.14, 0.18, 0.36), (0.16, 0.22, 0.44), "checks", 0.59),
    ("bowl-coral", "validation", 0.0730, (0.94, 0.52, 0.42), (0.98, 0.80, 0.72), (0.98, 0.84, 0.76), "spiral", 0.49),
]  # fmt: skip

# name, split, radius [m], base, accent, pattern, well
PLATES = [
    ("plate-white", "train", 0.068, WHITE, (0.30, 0.38, 0.55), "plain", 0.64),
    ("plate-blue-band", "train", 0.071, (0.95, 0.95, 0.95), (0.20, 0.34, 0.62), "band", 0.62),
    ("plate-green-rings", "train", 0.0745, (0.86, 0.90, 0.80), (0.40, 0.58, 0.36), "rings", 0.60),
    ("plate-sand", "train", 0.0775, (0.82, 0.74, 0.60), (0.52, 0.42, 0.30), "speckles", 0.66),
    ("plate-grey-dots", "train", 0.0805, (0.62, 0.65, 0.69), WHITE, "dots", 0.63),
    ("plate-rust", "train", 0.084, (0.66, 0.34, 0.22), (0.42, 0.20, 0.14), "glaze", 0.68),
    ("plate-teal-rays", "unseen", 0.0685, (0.84, 0.92, 0.92), (0.10, 0.48, 0.50), "rays", 0.61),
    ("plate-rose-petals", "unseen", 0.072, (0.97, 0.92, 0.92), (0.78, 0.30, 0.40), "petals", 0.58),
    ("plate-black-checks", "unseen", 0.075, (0.90, 0.89, 0.86), (0.14, 0.14, 0.15), "checks", 0.65),
    ("plate-lilac", "unseen", 0.0785, (0.70, 0.62, 0.82), (0.46, 0.36, 0.64), "spiral", 0.62),
    ("plate-sunflower", "unseen", 0.081, (0.96, 0.80, 0.24), (0.72, 0.40, 0.10), "petals", 0.60),
    ("plate-slate", "unseen", 0.0845, (0.30, 0.34, 0.38), (0.62, 0.68, 0.72), "rays", 0.67),
    ("plate-aqua-checks", "validation", 0.0695, (0.90, 0.96, 0.98), (0.24, 0.60, 0.74), "checks", 0.63),
    ("plate-olive", "validation", 0.0765, (0.52, 0.54, 0.28), (0.78, 0.78, 0.52), "spiral", 0.64),
    ("plate-berry", "validation", 0.083, (0.96, 0.90, 0.94), (0.56, 0.14, 0.34), "rays", 0.59),
]  # fmt: skip

# name, split, length [m], kind, metal, handle, slimness of the handle
PIECES = [
    ("fork-steel", "train", 0.182, "fork", STEEL, None, 0.52),
    ("knife-steel", "train", 0.200, "knife", STEEL, None, 0.62),
    ("spoon-steel", "train", 0.178, "spoon", STEEL, None, 0.50),
    ("teaspoon-steel", "train", 0.162, "spoon", (0.66, 0.67, 0.70), None, 0.42),
    ("fork-black", "train", 0.190, "fork", STEEL, (0.16, 0.16, 0.18), 0.68),
    ("knife-wood", "train", 0.196, "knife", STEEL, (0.50, 0.32, 0.18), 0.74),
    ("fork-gold", "unseen", 0.180, "fork", GOLD, None, 0.46),
    ("spoon-gold", "unseen", 0.172, "spoon", GOLD, None, 0.44),
    ("knife-red", "unseen", 0.198, "knife", (0.68, 0.70, 0.74), (0.72, 0.16, 0.14), 0.66),
    ("spork-steel", "unseen", 0.166, "spork", (0.62, 0.63, 0.66), None, 0.56),
    ("spoon-blue", "unseen", 0.186, "spoon", STEEL, (0.16, 0.32, 0.62), 0.72),
    ("fork-ivory", "unseen", 0.192, "fork", (0.70, 0.71, 0.74), (0.92, 0.88, 0.76), 0.70),
    ("fork-copper", "validation", 0.176, "fork", (0.74, 0.48, 0.36), None, 0.50),
    ("knife-green", "validation", 0.194, "knife", STEEL, (0.18, 0.46, 0.28), 0.70),
    ("spork-copper", "validation", 0.170, "spork", (0.72, 0.50, 0.40), None, 0.60),
]  # fmt: skip

# name, split, radius [m], tint, body, foot, facets, rim
GLASSES = [
    ("tumbler-clear", "train", 0.0410, (0.92, 0.96, 0.97), 0.16, 0.66, 0, 0.060),
    ("tumbler-thick", "train", 0.0430, (0.88, 0.93, 0.94), 0.20, 0.58, 0, 0.095),
    ("tumbler-blue", "train", 0.0445, (0.62, 0.80, 0.94), 0.24, 0.62, 0, 0.065),
    ("tumbler-green", "train", 0.0460, (0.66, 0.88, 0.72), 0.22, 0.70, 0, 0.070),
    ("cut-glass", "train", 0.0475, (0.94, 0.96, 0.98), 0.18, 0.60, 10, 0.075),
    ("beaker-smoke", "train", 0.0495, (0.62, 0.64, 0.66), 0.26, 0.64, 0, 0.060),
    ("tumbler-amber", "unseen", 0.0415, (0.94, 0.78, 0.50), 0.22, 0.60, 0, 0.070),
    ("cut-glass-octagon", "unseen", 0.0430, (0.90, 0.95, 0.96), 0.18, 0.54, 8, 0.085),
    ("tumbler-rose", "unseen", 0.0445, (0.94, 0.70, 0.76), 0.22, 0.68, 0, 0.060),
    ("beaker-thin", "unseen", 0.0460, (0.95, 0.97, 0.97), 0.14, 0.74, 0, 0.050),
    ("tumbler-violet", "unseen", 0.0480, (0.76, 0.70, 0.92), 0.22, 0.56, 0, 0.080),
    ("cut-glass-hexagon", "unseen", 0.0490, (0.80, 0.92, 0.90), 0.20, 0.62, 6, 0.070),
    ("tumbler-teal", "validation", 0.0420, (0.52, 0.82, 0.82), 0.22, 0.65, 0, 0.075),
    ("cut-glass-dozen", "validation", 0.0455, (0.93, 0.95, 0.94), 0.17, 0.57, 12, 0.065),
    ("beaker-honey", "validation", 0.0485, (0.92, 0.84, 0.58), 0.23, 0.71, 0, 0.055),
]  # fmt: skip

# name, split, kind, light, dark
SURFACES = [
    ("oak", "train", "wood", (0.74, 0.58, 0.40), (0.52, 0.36, 0.22)),
    ("walnut", "train", "wood", (0.46, 0.32, 0.22), (0.28, 0.19, 0.13)),
    ("birch", "train", "planks", (0.86, 0.78, 0.64), (0.70, 0.58, 0.42)),
    ("linen", "train", "linen", (0.82, 0.79, 0.72), (0.64, 0.60, 0.53)),
    ("granite", "train", "stone", (0.56, 0.57, 0.58), (0.34, 0.35, 0.37)),
    ("laminate", "train", "laminate", (0.58, 0.68, 0.68), (0.44, 0.54, 0.55)),
    ("marble", "unseen", "marble", (0.90, 0.89, 0.88), (0.56, 0.57, 0.60)),
    ("cherry", "unseen", "planks", (0.60, 0.32, 0.22), (0.42, 0.20, 0.13)),
    ("denim", "unseen", "linen", (0.36, 0.44, 0.58), (0.20, 0.27, 0.40)),
]  # fmt: skip


def designs() -> list[Design]:
    """Every item, in the catalogue's order: symbol by symbol, training items first."""
    return [
        *(Design(n, "bowl", s, "disc", r, 0.0, partial(bowl, i, *look)) for i, (n, s, r, *look) in enumerate(BOWLS)),
        *(Design(n, "plate", s, "disc", r, 0.0, partial(plate, i, *look)) for i, (n, s, r, *look) in enumerate(PLATES)),
        *(
            Design(
                n, "cutlery", s, "capsule", HALF_WIDTH, round(length / 2 - HALF_WIDTH, 4),
                partial(cutlery, i, kind, length, *look),
            )
            for i, (n, s, length, kind, *look) in enumerate(PIECES)
        ),
        *(Design(n, "glass", s, "disc", r, 0.0, partial(glass, *look)) for n, s, r, *look in GLASSES),
    ]  # fmt: skip


def surfaces() -> dict[str, tuple[str, Callable[[], np.ndarray]]]:
    """Every table top: its split and how to draw it."""
    return {name: (split, partial(surface, i, *look)) for i, (name, split, *look) in enumerate(SURFACES)}
