"""The paper's Table 2: mean P(valid) without and with an added item, bold where the change is significant.

The paper: "The cells in bold indicate significant change with respect to the no intervention column."
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.causal.interventions import estimate_effects
from pipeline.stats.tests import LEVEL, SMALLEST_EFFECT
from pipeline.world.rules import PAPER_P_VALID

NONE = "none"  # the column without an intervention
PAPER, TRUTH = "the paper", "truth"  # sources beside the variants, none of which may be called so
PAPER_BOLD = {  # (user, symbol) of the cells that the paper prints in bold
    ("careful", "bowl"), ("careful", "plate"), ("careful", "cutlery"), ("careful", "glass"), ("normal", "glass"),
}  # fmt: skip
COLUMNS = ["source", "user", "change", "mean", "q1", "q3", "effect", "ci_low", "ci_high", "p_holm", "bold", "beyond"]


def bold_rows(
    source: str,
    changes: Sequence[tuple[str, str]],
    baseline: Float[Array, "change seed scene"],
    intervened: Float[Array, "change seed scene"],
) -> pd.DataFrame:
    """Return a source's block of Table 2, one row per cell, with COLUMNS.

    changes: (user, symbol) of each change; baseline, intervened: P(valid) in the same scenes without and with the item.
    mean, q1, q3: mean and quartiles of P(valid) over seeds, or over scenes if there is one seed (the truth). bold: the
    effect is significant at 5 % after Holm's correction over these changes. beyond: its 95 % interval lies beyond
    +-SMALLEST_EFFECT. Raises ValueError unless the numbers are finite and of at least two scenes.
    """
    estimates = estimate_effects(intervened - baseline)
    rows = pd.DataFrame(changes, columns=["user", "change"]).assign(source=source, **_levels(intervened))
    rows = rows.join(estimates[["effect", "ci_low", "ci_high", "p_holm"]])
    rows["bold"] = rows["p_holm"] < LEVEL
    rows["beyond"] = (rows["ci_low"] > SMALLEST_EFFECT) | (rows["ci_high"] < -SMALLEST_EFFECT)
    first = rows.drop_duplicates("user").index  # all changes of a user share their baseline
    without = pd.DataFrame({"source": source, "user": rows.loc[first, "user"], "change": NONE, "bold": False})
    without = without.assign(beyond=False, **_levels(baseline[first]))
    blocks = [pd.concat([without[without["user"] == u], rows[rows["user"] == u]]) for u in without["user"]]
    return pd.concat(blocks, ignore_index=True).reindex(columns=COLUMNS)


def _levels(p: Float[Array, "change seed scene"]) -> dict[str, Float[Array, " change"]]:
    """Return mean and quartiles of P(valid) over seeds, or over scenes if there is one seed."""
    values = p.mean(-1) if p.shape[1] > 1 else p[:, 0]
    q1, q3 = np.quantile(values, (0.25, 0.75), axis=-1)
    return {"mean": p.mean((1, 2)), "q1": q1, "q3": q3}


def paper_rows(users: Sequence[str], symbols: Sequence[str]) -> pd.DataFrame:
    """Return the paper's block as printed, of those users and symbols that it has, with COLUMNS."""
    rows = [
        {"source": PAPER, "user": user, "change": change, "mean": mean, "bold": (user, change) in PAPER_BOLD}
        for user, means in PAPER_P_VALID.items()
        for change, mean in means.items()
        if user in users and change in (NONE, *symbols)
    ]
    return pd.DataFrame(rows, columns=COLUMNS).assign(beyond=False)


def cells_as_in_the_paper(table: pd.DataFrame) -> dict[str, int]:
    """Return source -> the number of changes that are bold or plain as in the paper; 12 where all are asked."""
    printed = [change != NONE and change in PAPER_P_VALID.get(user, ()) for user, change in _cells(table)]
    known = table[printed]
    agree = known["bold"].astype(bool) == [cell in PAPER_BOLD for cell in _cells(known)]
    return {str(source): int(count) for source, count in agree.groupby(known["source"], sort=False).sum().items()}


def never_bold(table: pd.DataFrame) -> str:
    """Return how many of the paper's cells a source without a bold cell has as the paper, such as "7 of 12"."""
    printed = table[(table["source"] == PAPER) & (table["change"] != NONE)]["bold"].astype(bool)
    return f"{int((~printed).sum())} of {len(printed)}"


def _cells(table: pd.DataFrame) -> list[tuple[str, str]]:
    return list(zip(table["user"], table["change"], strict=True))
