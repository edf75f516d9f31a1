"""Effects of interventions from arrays of expected validity: no model, image or rule is known here.

The estimand (the paper's second inequality) is the average causal effect

    ACE(s, o) = E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s]

over the same scenes, paths and seeds on both sides. For the first inequality do(S := s') takes the place of do(Z_I).
"""

from collections.abc import Sequence
from dataclasses import fields
from itertools import permutations

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.stats.crossed import Estimates, add_pseudo_scenes, estimate
from pipeline.stats.tests import holm, true_verdict, verdict

JUDGED = ["effect", "q1", "q3", "ci_low", "ci_high", "ci90_low", "ci90_high", "p_holm", "verdict"]


def expected_validity(p: Float[Array, "*b path"]) -> Float[Array, "*b"]:
    """Return E[V] over the paths: V is 1 with probability p, so its expectation is the mean of p (Table 2)."""
    return np.asarray(np.mean(p, axis=-1, dtype=np.float64))


def ordered_pairs(users: Sequence[str]) -> list[tuple[str, str]]:
    """Return every (s, s') with s' != s, for do(S := s') among units of S = s."""
    return list(permutations(users, 2))


def judge(effects: Float[Array, "question seed scene"]) -> pd.DataFrame:
    """Return one family's questions, a row each in order, with the columns JUDGED.

    effect: mean over seeds and scenes; q1, q3: quartiles of the seeds' means; ci_, ci90_: 95 % and 90 % intervals over
    seeds crossed with scenes; p_holm: corrected over the family; verdict: one of `pipeline.stats.tests.VERDICTS`.
    ValueError unless the effects are finite and of at least two scenes.
    """
    estimates = estimate(add_pseudo_scenes(effects))
    table = pd.DataFrame({field.name: getattr(estimates, field.name) for field in fields(Estimates)})
    table["p_holm"] = holm(estimates.p)
    columns = (table[name] for name in ("effect", "p_holm", "ci90_low", "ci90_high"))
    table["verdict"] = [verdict(*row) for row in zip(*columns, strict=True)]
    return table[JUDGED]


def study(
    baseline: Float[Array, "question seed scene"],
    intervened: Float[Array, "question seed scene"],
    true_baseline: Float[Array, "question scene"],
    true_intervened: Float[Array, "question scene"],
) -> pd.DataFrame:
    """Return `judge` of the effects beside the truth, a row a question in order.

    Further columns: baseline, intervened (means); truth (the true effect); truth_verdict; right: the verdict is the
    true one and, for an effect, has the true sign.
    """
    table = judge(intervened - baseline)
    table["baseline"], table["intervened"] = baseline.mean((1, 2)), intervened.mean((1, 2))
    table["truth"] = (true_intervened - true_baseline).mean(-1)
    table["truth_verdict"] = [true_verdict(effect) for effect in table["truth"]]
    same_sign = np.sign(table["effect"]) == np.sign(table["truth"])
    table["right"] = (table["verdict"] == table["truth_verdict"]) & (same_sign | (table["verdict"] == "negligible"))
    return table
