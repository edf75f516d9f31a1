"""Estimate a safety envelope by dose and response: the clearance [m] from an added item at which validity changes.

The dose is the clearance c between a path and the added item o. The response is the loss of expected validity

    response(c) = E[V | do(Z_theta := z)] - E[V | do(Z_theta := z, Z_I := E(I + o))],  clearance(z, o) = c,

over the same paths z and scenes on both sides. The paths keep farther away from all other items than any user requires.
The true response is therefore 1 within the user's margin and 0 beyond it, regardless of the other items.

The radius is the dose of half the effect (ED50): response(c) is half of the response at contact. Unlike the mean
tolerance (Spearman and Kaerber), it does not depend on the largest dose and needs no model of the curve. Its interval
inverts a test: it holds the doses at which response(c) - response(0) / 2 does not differ from zero. The difference's
mean and pointwise bounds are first made decreasing by isotonic regression. This keeps the bounds valid if the true
curve decreases (Chernozhukov, Fernandez-Val and Galichon, 2009), and gives each a single zero crossing. The interval
of a flat curve extends to the end of the doses.

The interval covers three sources of chance: training sets, added items (a planner will meet other items of the symbol),
and the items shared by all training sets (pipeline.stats.crossed.inflate_item_variance). It covers no further bias.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.optimize import isotonic_regression

from pipeline.stats.crossed import Estimates, by_item, estimate, inflate_item_variance
from pipeline.stats.tests import holm, verdict

Doses, Clearances = Float[Array, " dose"], Float[Array, "scene path"]  # [m]


def dose_grid(step: float, doses: int) -> Doses:
    """Return the centre [m] of each interval of clearance, `step` wide; the first lies inside the item (contact)."""
    return step * (np.arange(doses) - 0.5)


def path_at_doses(
    to_added: Clearances, to_others: Clearances, doses: Doses, clear_of_others: float
) -> Int[Array, "scene dose"]:
    """Return the first path at each dose that keeps `clear_of_others` [m] away from all other items.

    to_added: clearance [m] from the added item; to_others: smallest clearance from any other. Within a dose, the paths
    remain uniformly distributed. A dose without a path is missing in its scene (-1); without contact, all doses are.
    """
    dose = np.floor((to_added - doses[0]) / (doses[1] - doses[0]) + 0.5)
    fitting = (dose[..., None] == np.arange(len(doses))) & (to_others >= clear_of_others)[..., None]
    chosen = np.where(fitting.any(1), fitting.argmax(1), -1)
    return np.where(chosen[:, :1] < 0, -1, chosen)


def envelopes(
    response: Float[Array, "question seed scene dose"],
    item: Int[Array, "question scene"],
    n_training: Sequence[int | None],
    margins: Sequence[float | None],
    doses: Doses,
) -> pd.DataFrame:
    """Return one family's envelopes (questions: users x symbols), one row per question; lengths in metres.

    item: the added item; n_training: number of items of the symbol in the training sets, None if nothing was learned
    from items; margins: the true margins, None if there is none. NaN: the dose is missing in the scene.

    An envelope exists if the response at contact is a positive effect (items in place of scenes).
    Columns: radius_m, ci_low, ci_high (NaN: no envelope), true_radius_m (NaN: no margin), response (at contact),
    p_holm, verdict, right (envelope and margin both exist, or neither), covered (the interval contains the margin; None
    unless both exist).
    """
    by_question = [by_item(values, items) for values, items in zip(response, item, strict=True)]
    touched = [~np.isnan(values[..., 0]).any(0) for values in by_question]  # items with at least one path in contact
    asked = zip(by_question, touched, n_training, strict=True)
    contacts = [_estimate(values[None, :, some, 0], n) for values, some, n in asked]
    adjusted = holm(np.array([contact.p[0] for contact in contacts]))
    rows = []
    for values, some, n, contact, p_holm, margin in zip(
        by_question, touched, n_training, contacts, adjusted, margins, strict=True
    ):
        at_contact = float(contact.effect[0])
        ends = [float(getattr(contact, end)[0]) for end in ("ci_low", "ci_high", "ci90_low", "ci90_high")]
        if ends[0] == ends[1] == 1:  # of all items, always: exact ends of a share (Clopper and Pearson, 1934)
            ends = [0.025 ** (1 / some.sum()), 1.0, 0.05 ** (1 / some.sum()), 1.0]
        judged = verdict(*ends)
        is_there = judged == "effect" and at_contact > 0
        middle, low, high = radius(values, doses, n) if is_there else (np.nan,) * 3
        covered = low <= margin <= high if is_there and margin is not None else None
        true, right = np.nan if margin is None else margin, is_there == (margin is not None)
        rows.append((middle, low, high, true, at_contact, float(p_holm), judged, right, covered))
    columns = ["radius_m", "ci_low", "ci_high", "true_radius_m", "response", "p_holm", "verdict", "right", "covered"]
    return pd.DataFrame(rows, columns=columns).astype({"covered": "boolean"})


def response_curve(
    response: Float[Array, "seed scene dose"], item: Int[Array, " scene"], n_training: int | None, doses: Doses
) -> pd.DataFrame:
    """Return one question's mean response by dose with its 95 % interval: clearance_m, response, ci_low, ci_high."""
    estimates = _estimate_doses(by_item(response, item), n_training)
    return pd.DataFrame({"clearance_m": doses, "response": estimates.pop("effect"), **estimates})


def radius(
    response: Float[Array, "seed item dose"], doses: Doses, n_training: int | None = None
) -> tuple[float, float, float]:
    """Return the clearance [m] of half the effect and its 95 % interval; a bound at the end of the grid is open.

    n_training: number of items in the training sets; None: nothing was learned from items.
    """
    halves = _estimate_doses(response - response[..., :1] / 2, n_training)

    def zero_crossing(values: Float[Array, " dose"]) -> float:
        falling = isotonic_regression(values, increasing=False).x  # the nearest decreasing curve
        after = int((falling > 0).sum())  # the first dose with a value of at most zero
        if after in (0, len(doses)):
            return float(doses[min(after, len(doses) - 1)])
        around = slice(after - 1, after + 1)
        return float(np.interp(0, -falling[around], doses[around]))  # linear between doses

    return zero_crossing(halves["effect"]), zero_crossing(halves["ci_low"]), zero_crossing(halves["ci_high"])


def _estimate_doses(response: Float[Array, "seed item dose"], n_training: int | None) -> dict[str, Array]:
    """Return effect, ci_low and ci_high, each (dose,), over the items with that dose."""
    has_dose = np.asarray(~np.isnan(response).any(0)).T  # (dose, item)
    ends = {name: np.empty(len(has_dose)) for name in ("effect", "ci_low", "ci_high")}
    for items in np.unique(has_dose, axis=0):
        doses = (has_dose == items).all(1)
        estimates = _estimate(np.moveaxis(response[:, items][..., doses], -1, 0), n_training)
        for name, values in ends.items():
            values[doses] = getattr(estimates, name)
    return ends


def _estimate(response: Float[Array, "question seed item"], n_training: int | None) -> Estimates:
    """Return the estimates, including the variance due to the `n_training` items that all training sets share."""
    if n_training is not None:
        response = np.stack([inflate_item_variance(values, n_training) for values in response])
    return estimate(response)
