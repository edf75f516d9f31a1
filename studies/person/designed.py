"""Labels until a person's rule is known: on tables chosen by expected information, and on random ones."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from pipeline.own.design import MARGINS_M, VARIANTS, Rules, evenly, question
from pipeline.world.bezier import P_F, P_INIT, bezier, random_z_theta

ITEMS, PATHS, POINTS = 3, 20, 60  # items on each table; random paths across it; points along a path
RADIUS_M, HALF_LENGTH_M, FROM_EDGE_M = (0.02, 0.06), (0.0, 0.06), 0.15  # of random capsules
LABELS = 48  # of a person, at most
WITHIN_M = 0.01  # error of a margin that is right
CHOICES = "designed", "random"


def labels(
    choice: str, kinds: int, margins_m: Sequence[float], tables: int, lapses: float, rng: np.random.Generator
) -> int:
    """Return after how many labels a person's rule is known for good; LABELS + 1 if it is not by then.

    The rule is any variant, with a margin of `margins_m` for each kind. It is known if the likeliest variant is right,
    and so are, for each kind, whether it matters and the likeliest margin, to WITHIN_M. Both choices are among the same
    paths, and none is labelled twice.
    """
    asked = random_questions(rng, tables, kinds)
    rules, variant, margin = Rules.unknown(kinds, rng), rng.integers(len(VARIANTS)), rng.choice(margins_m, kinds)
    answers = (asked[:, variant] >= np.where(margin > 0, margin, -np.inf)).all(1)
    answers ^= rng.random(len(asked)) < lapses / 2  # half of those who do not look are right
    accepted, left = rules.accept(asked), rng.permutation(len(asked)).tolist()
    known_after = LABELS + 1
    for n in range(1, LABELS + 1):
        best = int(rules.information(accepted[left]).argmax()) if choice == "designed" else 0
        row = left.pop(best)
        rules = rules.told(accepted[row], bool(answers[row]))
        p_variant, p_margin = rules.known()
        likeliest = MARGINS_M[p_margin.argmax(1)]
        right = bool(((likeliest > 0) == (margin > 0)).all() and (np.abs(likeliest - margin) < WITHIN_M + 1e-9).all())
        right &= bool(p_variant.argmax() == variant or not margin.any())
        known_after = min(known_after, n) if right else LABELS + 1
    return known_after


def random_questions(rng: np.random.Generator, tables: int, kinds: int) -> Float[Array, "question variant kind"]:
    """Return what random paths across random tables ask, PATHS a table."""
    made = []
    for _ in range(tables):
        centre, angle = rng.uniform(FROM_EDGE_M, 1 - FROM_EDGE_M, (ITEMS, 2)), rng.uniform(0, np.pi, ITEMS)
        along = np.stack([np.cos(angle), np.sin(angle)], -1) * rng.uniform(*HALF_LENGTH_M, (ITEMS, 1))
        ends, radius = np.stack([centre - along, centre + along], 1), rng.uniform(*RADIUS_M, ITEMS)
        kind: Int[Array, " item"] = rng.integers(kinds, size=ITEMS)
        for _ in range(PATHS):
            line = bezier(np.stack([P_INIT, random_z_theta(rng), P_F]), POINTS)
            made.append(question(evenly(line, POINTS), ends, radius, kind, kinds))
    return np.stack(made)
