"""Effects of interventions, from arrays of expected validity: no model, no image, no rule is known here.

The estimand (design.md; the paper's second inequality) is the average causal effect

    ACE(s, o) = E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s]

over the same scenes, paths and seeds on both sides. For the first inequality do(S := s') takes the place of
do(Z_I).
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.stats.crossed import add_pseudo_scenes, estimate, holm, true_verdict, verdict
from pipeline.world.layout import SYMBOLS

DIGITS = 6  # of every reported number


def expected_validity(p: Float[Array, "*b path"]) -> Float[Array, "*b"]:
    """E[V] over the paths: V is 1 with probability p, so its expectation is the mean p (Table 2)."""
    return np.asarray(np.mean(p, axis=-1, dtype=np.float64))


def over_placements(intervened: Float[Array, "*b symbol placement scene"]) -> Float[Array, "*b symbol scene"]:
    """E[V | do(Z_I := E(I + o))] in each scene: the added symbol's random places averaged."""
    return intervened.mean(-2)


def ordered_pairs(users: Sequence[str]) -> list[tuple[str, str]]:
    """Every (s, s') with s' != s, for do(S := s') in units of S = s."""
    return list(permutations(users, 2))


def by_user(users: Sequence[str], cells: Sequence[dict]) -> dict[str, dict[str, dict]]:
    """Cells (user * symbol), user by user, as user -> symbol -> cell."""
    rest = iter(cells)
    return {user: {symbol: next(rest) for symbol in SYMBOLS} for user in users}


def judge(effects: Float[Array, "cell seed scene"]) -> list[dict]:
    """One family of cells: each one's mean effect, how sure we are (Holm over the family), and the verdict."""
    e = estimate(add_pseudo_scenes(effects))
    adjusted = holm(e.p)
    return [
        _rounded(
            effect=e.effect[i], q1=e.q1[i], q3=e.q3[i], ci_low=e.ci_low[i], ci_high=e.ci_high[i],
            ci90_low=e.ci90_low[i], ci90_high=e.ci90_high[i], p_holm=p_holm,
        )
        | {"verdict": verdict(e.effect[i], p_holm, e.ci90_low[i], e.ci90_high[i])}
        for i, p_holm in enumerate(adjusted)
    ]  # fmt: skip


def study(
    baseline: Float[Array, "cell seed scene"],
    intervened: Float[Array, "cell seed scene"],
    true_baseline: Float[Array, "cell scene"],
    true_intervened: Float[Array, "cell scene"],
) -> list[dict]:
    """`judge` of the effects, and the truth beside each cell.

    `right`: the verdict is the true one and, for an effect, of the true sign.
    """
    cells = judge(intervened - baseline)
    truth = (true_intervened - true_baseline).mean(-1)
    for i, cell in enumerate(cells):
        deserved, found = true_verdict(truth[i]), cell["verdict"]
        same_sign = np.sign(cell["effect"]) == np.sign(truth[i])
        cell |= _rounded(
            baseline=baseline[i].mean(), intervened=intervened[i].mean(), truth=truth[i],
            truth_baseline=true_baseline[i].mean(), truth_intervened=true_intervened[i].mean(),
        )  # fmt: skip
        cell |= {"truth_verdict": deserved, "right": bool(found == deserved and (found == "negligible" or same_sign))}
    return cells


def _rounded(**numbers: float) -> dict[str, float]:
    return {name: round(float(value), DIGITS) + 0.0 for name, value in numbers.items()}  # + 0.0: never -0.0


def tally(cells: Sequence[dict]) -> dict[str, int]:
    """How many verdicts are right, and in which way the others are wrong."""
    return {
        "cells": len(cells),
        "right": sum(c["right"] for c in cells),
        "false_causes": sum(c["verdict"] == "effect" and not c["right"] for c in cells),
        "missed_causes": sum(c["verdict"] == "negligible" and not c["right"] for c in cells),
        "undecided": sum(c["verdict"] == "undecided" for c in cells),
    }
