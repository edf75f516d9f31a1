"""Estimate and judge effects of interventions from arrays of expected validity; the paper's Table 2 of them.

The estimand is the average causal effect of the paper's second inequality,

    ACE(s, o) = E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s]

over the same scenes, paths and seeds on both sides. For the first inequality, do(S := s') replaces do(Z_I).

Predictions p of scenes without and with added items have an axis `version`: version 0 is the original scene, version
1 + k the scene with symbol k added. Their questions are pairs of user and symbol, ordered by user, then symbol.
"""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.stats.crossed import Effects, Estimates, Items, estimate, items_held
from pipeline.stats.tests import LEVEL, SMALLEST_EFFECT, holm, verdict
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import PAPER_P_VALID

ESTIMATE_COLUMNS = ["effect", "q1", "q3", "ci_low", "ci_high", "ci90_low", "ci90_high", "p_holm", "verdict"]
NONE = "none"  # Table 2's column without an intervention
PAPER, TRUTH = "the paper", "truth"  # sources beside the variants, none of which may be called so
Predicted = Float[Array, "user seed version scene path"]
PAPER_BOLD = {  # (user, symbol) of the cells that the paper prints in bold
    ("careful", "bowl"), ("careful", "plate"), ("careful", "cutlery"), ("careful", "glass"), ("normal", "glass"),
}  # fmt: skip
BOLD_COLUMNS = "source", "user", "change", "mean", "q1", "q3", "effect", "ci_low", "ci_high", "p_holm", "bold", "beyond"


def estimate_effects(effects: Effects, items: Items = None) -> pd.DataFrame:
    """Return estimates and verdicts of a family of questions, one row per question, with ESTIMATE_COLUMNS.

    effect: mean over seeds and scenes; q1, q3: quartiles of the seeds' means; ci_, ci90_: 95 % and 90 % intervals over
    seeds crossed with scenes, corrected for skewness unless `items` are chance; p_holm: corrected over the family;
    verdict: of `pipeline.stats.tests.verdict`. ValueError unless the effects are finite and of at least two scenes.
    """
    estimates = estimate(effects, items is None, items)
    table = pd.DataFrame({field.name: getattr(estimates, field.name) for field in fields(Estimates)})
    table["p_holm"] = holm(estimates.p)
    columns = (table[name] for name in ("ci_low", "ci_high", "ci90_low", "ci90_high"))
    table["verdict"] = [verdict(*row) for row in zip(*columns, strict=True)]
    return table[ESTIMATE_COLUMNS]


def compare_with_truth(
    baseline: Effects,
    intervened: Effects,
    true_baseline: Float[Array, "question scene"],
    true_intervened: Float[Array, "question scene"],
    items: Items = None,
) -> pd.DataFrame:
    """Return `estimate_effects` of the effects together with the truth, one row per question.

    Further columns: baseline, intervened (means); truth (the true effect); truth_verdict; right: the verdict is the
    true one and, for an effect, the sign is correct.
    """
    table = estimate_effects(intervened - baseline, items)
    table["baseline"], table["intervened"] = baseline.mean((1, 2)), intervened.mean((1, 2))
    table["truth"] = (true_intervened - true_baseline).mean(-1)
    table["truth_verdict"] = ["effect" if abs(effect) > SMALLEST_EFFECT else "negligible" for effect in table["truth"]]
    same_sign = np.sign(table["effect"]) == np.sign(table["truth"])
    table["right"] = (table["verdict"] == table["truth_verdict"]) & (same_sign | (table["verdict"] == "negligible"))
    return table


def questions(users: Sequence[str]) -> pd.DataFrame:
    """Return the user and symbol of each question."""
    return pd.MultiIndex.from_product([list(users), SYMBOLS], names=["user", "symbol"]).to_frame(index=False)


def expected_by_version(p: Predicted) -> tuple[Effects, Effects]:
    """Return E[V], the mean of p over paths, without the item and with it."""
    expected = p.mean(-1, dtype=np.float64)
    after = np.moveaxis(expected[:, :, 1:], 2, 1)  # (user, symbol, seed, scene)
    before = np.broadcast_to(expected[:, None, :, 0], after.shape)
    return before.reshape(-1, *after.shape[2:]), after.reshape(-1, *after.shape[2:])


def added_item_effects(p: Predicted) -> Effects:
    """Return E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s] of each question (paper, second inequality)."""
    before, after = expected_by_version(p)
    return after - before


def verdicts(
    users: Sequence[str], p: Predicted, valid: Bool[Array, "user version scene path"], layouts: Sequence[Layouts] = ()
) -> pd.DataFrame:
    """Return user, symbol and the columns of `compare_with_truth` for each question; all questions form one family.

    layouts: the versions' if the added items are chance.
    """
    true_before, true_after = (x[:, 0] for x in expected_by_version(valid[:, None].astype(float)))
    items = np.tile(added_items(layouts), (len(users), 1, 1)) if len(layouts) else None
    judged = compare_with_truth(*expected_by_version(p), true_before, true_after, items=items)
    return pd.concat([questions(users), judged], axis=1)


def added_items(layouts: Sequence[Layouts]) -> Int[Array, "symbol scene item"]:
    """Return the item that each further version of the scenes adds, in its last occupied slot, by kind (`Items`)."""
    last = [
        np.take_along_axis(np.stack([x.item, x.symbol]), x.present.sum(1)[None, :, None] - 1, axis=2)
        for x in layouts[1:]
    ]
    item, symbol = np.stack(last, axis=1)  # (version, scene, 1)
    return items_held(item, symbol)


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


def bold_rows(
    source: str, changes: Sequence[tuple[str, str]], baseline: Effects, intervened: Effects, items: Items = None
) -> pd.DataFrame:
    """Return a source's block of Table 2: mean P(valid) without and with an added item, bold where it changes.

    The paper: "The cells in bold indicate significant change with respect to the no intervention column."

    changes: (user, symbol) of each change; baseline, intervened: P(valid) in the same scenes without and with the item.
    One row per cell, with BOLD_COLUMNS. mean, q1, q3: mean and quartiles of P(valid) over seeds, or over scenes if
    there is one seed (the truth). bold: the effect is significant at 5 % after Holm's correction over these changes.
    beyond: its 95 % interval lies beyond +-SMALLEST_EFFECT. Raises ValueError as `estimate_effects`.
    """

    def levels(p: Effects) -> dict[str, Float[Array, " question"]]:
        values = p.mean(-1) if p.shape[1] > 1 else p[:, 0]
        q1, q3 = np.quantile(values, (0.25, 0.75), axis=-1)
        return {"mean": p.mean((1, 2)), "q1": q1, "q3": q3}

    estimates = estimate_effects(intervened - baseline, items)
    rows = pd.DataFrame(changes, columns=["user", "change"]).assign(source=source, **levels(intervened))
    rows = rows.join(estimates[["effect", "ci_low", "ci_high", "p_holm"]])
    rows["bold"] = rows["p_holm"] < LEVEL
    rows["beyond"] = (rows["ci_low"] > SMALLEST_EFFECT) | (rows["ci_high"] < -SMALLEST_EFFECT)
    first = rows.drop_duplicates("user").index  # all changes of a user share their baseline
    without = pd.DataFrame({"source": source, "user": rows.loc[first, "user"], "change": NONE, "bold": False})
    without = without.assign(beyond=False, **levels(baseline[first]))
    blocks = [pd.concat([without[without["user"] == u], rows[rows["user"] == u]]) for u in without["user"]]
    return pd.concat(blocks, ignore_index=True).reindex(columns=BOLD_COLUMNS)


def paper_rows(users: Sequence[str], symbols: Sequence[str]) -> pd.DataFrame:
    """Return the paper's block as printed, of those users and symbols that it has, with BOLD_COLUMNS."""
    known = NONE, *symbols
    cells = [(u, c, m) for u in PAPER_P_VALID if u in users for c, m in PAPER_P_VALID[u].items() if c in known]
    rows = [{"source": PAPER, "user": u, "change": c, "mean": m, "bold": (u, c) in PAPER_BOLD} for u, c, m in cells]
    return pd.DataFrame(rows, columns=BOLD_COLUMNS).assign(beyond=False)


def cells_as_in_the_paper(table: pd.DataFrame) -> dict[str, int]:
    """Return source -> the number of changes that are bold or plain as in the paper; 12 where all are asked."""
    cells = zip(table["user"], table["change"], strict=True)
    known = table[[change != NONE and change in PAPER_P_VALID.get(user, ()) for user, change in cells]]
    agree = known["bold"].astype(bool) == [c in PAPER_BOLD for c in zip(known["user"], known["change"], strict=True)]
    return {str(source): int(count) for source, count in agree.groupby(known["source"], sort=False).sum().items()}


def bold_or_plain(table: pd.DataFrame) -> str:
    """Return a sentence on the numbers that are bold or plain as in the paper: its model's, and without the picture."""
    printed = table[(table["source"] == PAPER) & (table["change"] != NONE)]["bold"].astype(bool)
    count, blind, model = len(printed), int((~printed).sum()), cells_as_in_the_paper(table).get("full")
    ours = "" if model is None else f" its model {model} of {count};"
    return f"Numbers bold or plain as in the paper:{ours} with none bold, as without the picture, {blind} of {count}."
