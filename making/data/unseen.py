"""Draw the unseen items and table tops of the sealed test at random, so that nobody chooses them.

Ours are the generator's ranges (making.data.variety), the rules below, the names, and that one top is a veined stone.
Random are all else: colours, patterns, outlines, sizes, and the kinds of the other tops. The first draws that keep the
rules are taken. None was looked at before, and none was replaced.
"""

import numpy as np

from making.data.outline import ROUND, Outline
from making.data.variety import Row, varied, varied_tops

SEED = 2041  # of every draw
ITEMS = 6  # of each symbol
DRAWS = 400  # items of each symbol from which the first ITEMS that keep the rules are taken
MIN_COLOUR_GAP = 0.1  # least difference from each training colour, in its most different channel [1 = white]
MAX_TINT, MIN_NEUTRAL = 0.06, 0.5  # white and steel, which any item may share: channels alike, and not dark
MIN_OUTLINE_GAP = 0.05  # least difference from a circle as a share of the radius; facets of a cut glass differ by 0.03
TOPS = {"veins": "onyx", "checks": "gingham", "tiles": "tiles", "stripes": "ticking", "cracks": "crackle"}
# The patterns that resemble no training top, and the names of such tops.


def unseen_items(symbol: str, training: list[Row]) -> list[Row]:
    """Return rows of one of making.data.designs' tables that share no pattern, kind, colour or outline with `training`.

    Whites and steel may be shared. Pieces of cutlery are of different kinds.
    """
    shared_kind = {value for row in training for value in row if isinstance(value, str)}
    colours = np.array([colour for row in training for colour in _colours(row)])
    rows: list[Row] = []
    for row in varied(DRAWS, SEED)[symbol]:
        kinds = {value for value in row[2:] if isinstance(value, str)}
        near = [np.abs(colours - colour).max(1).min() < MIN_COLOUR_GAP for colour in _colours(row)]
        if kinds & shared_kind or any(near) or not _is_unlike_a_circle(row):
            continue
        if symbol == "cutlery":
            shared_kind |= kinds
        rows.append((f"{symbol}-u{len(rows) + 1}", "unseen", *row[2:]))
        if len(rows) == ITEMS:
            return rows
    raise ValueError(f"{symbol}: {len(rows)} of {DRAWS} draws keep the rules; {ITEMS} are needed")


def _colours(row: Row) -> list[tuple]:
    """Return the colours of a row but white and steel."""
    colours = [value for value in row if isinstance(value, tuple)]
    return [c for c in colours if max(c) - min(c) > MAX_TINT or min(c) < MIN_NEUTRAL]


def _is_unlike_a_circle(row: Row) -> bool:
    """Return whether an outline is stretched, cornered or lobed, or a glass's mouth narrow; cutlery has no outline."""
    outline = next((value for value in row if isinstance(value, Outline)), None)
    if outline is None or outline.stretch:
        return True
    bearing = np.linspace(-np.pi, np.pi, 361)
    gap = np.abs(outline(np.cos(bearing), np.sin(bearing)) - 1).max()
    return gap > MIN_OUTLINE_GAP or (outline is ROUND and row[-1] != 1.0 and not isinstance(row[-1], Outline))


def unseen_tops() -> list[Row]:
    """Return three rows of making.data.designs' table of table tops: a veined stone and two more of TOPS."""
    stone, *others = TOPS
    kinds = {stone, *np.random.default_rng([SEED, 2]).choice(others, 2, replace=False).tolist()}
    drawn = [row for row in varied_tops(9, SEED) if row[2] in kinds]
    return [(TOPS[kind], "unseen", kind, light, dark) for _, _, kind, light, dark in drawn]
