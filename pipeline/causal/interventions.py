"""Estimate effects of interventions from arrays of expected validity, independently of models, images and rules.

The estimand is the average causal effect of the paper's second inequality,

    ACE(s, o) = E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s]

over the same scenes, paths and seeds on both sides. For the first inequality, do(S := s') replaces do(Z_I).
"""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.stats.crossed import Estimates, estimate
from pipeline.stats.tests import holm, true_verdict, verdict

ESTIMATE_COLUMNS = ["effect", "q1", "q3", "ci_low", "ci_high", "ci90_low", "ci90_high", "p_holm", "verdict"]


def expected_validity(p: Float[Array, "*b path"]) -> Float[Array, "*b"]:
    """Return E[V] over paths: V is 1 with probability p, so its expectation is the mean of p (paper, Table 2)."""
    return np.asarray(np.mean(p, axis=-1, dtype=np.float64))


def estimate_effects(effects: Float[Array, "question seed scene"]) -> pd.DataFrame:
    """Return estimates and verdicts of a family of questions, one row per question, with ESTIMATE_COLUMNS.

    effect: mean over seeds and scenes; q1, q3: quartiles of the seeds' means; ci_, ci90_: 95 % and 90 % intervals over
    seeds crossed with scenes, corrected for skewness; p_holm: corrected over the family; verdict: one of
    `pipeline.stats.tests.VERDICTS`. ValueError unless the effects are finite and of at least two scenes.
    """
    estimates = estimate(effects, skewed=True)
    table = pd.DataFrame({field.name: getattr(estimates, field.name) for field in fields(Estimates)})
    table["p_holm"] = holm(estimates.p)
    columns = (table[name] for name in ("effect", "p_holm", "ci90_low", "ci90_high"))
    table["verdict"] = [verdict(*row) for row in zip(*columns, strict=True)]
    return table[ESTIMATE_COLUMNS]


def compare_with_truth(
    baseline: Float[Array, "question seed scene"],
    intervened: Float[Array, "question seed scene"],
    true_baseline: Float[Array, "question scene"],
    true_intervened: Float[Array, "question scene"],
) -> pd.DataFrame:
    """Return `estimate_effects` of the effects together with the truth, one row per question.

    Further columns: baseline, intervened (means); truth (the true effect); truth_verdict; right: the verdict is the
    true one and, for an effect, the sign is correct.
    """
    table = estimate_effects(intervened - baseline)
    table["baseline"], table["intervened"] = baseline.mean((1, 2)), intervened.mean((1, 2))
    table["truth"] = (true_intervened - true_baseline).mean(-1)
    table["truth_verdict"] = [true_verdict(effect) for effect in table["truth"]]
    same_sign = np.sign(table["effect"]) == np.sign(table["truth"])
    table["right"] = (table["verdict"] == table["truth_verdict"]) & (same_sign | (table["verdict"] == "negligible"))
    return table


def asked(summary: pd.DataFrame, kind: str, users: Sequence[str]) -> pd.DataFrame:
    """Return the rows of stage intervene's summary for one kind of question; of "add", those of `users` alone.

    users: those whose results are averaged; to the others every path is valid, and "no effect" is always right.
    """
    rows = summary[summary["kind"] == kind]
    return rows[rows["user"].isin(users)] if kind == "add" else rows


def right_verdicts(summary: pd.DataFrame, kind: str, users: Sequence[str]) -> dict[str, int]:
    """Return variant -> the number of its right verdicts on the questions of `asked`."""
    rows = asked(summary, kind, users)
    right = rows["right"].astype(bool).groupby(rows["variant"], sort=False).sum()
    return {str(variant): int(count) for variant, count in right.items()}
