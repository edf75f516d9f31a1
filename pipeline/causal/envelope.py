"""A safety envelope by dose and response: the clearance [m] from an added item at which validity flips.

The dose is the clearance c between a path and the added item o, the response the drop in expected validity

    drop(c) = E[V | do(Z_theta := z)] - E[V | do(Z_theta := z, Z_I := E(I + o))],  clearance(z, o) = c,

over the same paths z and scenes on both sides. The paths keep further from every other item than any user asks, for
then the truth's drop is exactly 1 within the user's margin and 0 beyond it: what else stands in a scene plays no part.

The radius is the dose of half the effect (ED50), where drop(c) is half of the drop in contact, item by item. The mean
tolerance (Spearman and Kaerber) moves with the tail of a curve, and so with the largest dose asked; the median does
not, and it needs no model of the curve. Its interval is a test turned round: the doses at which drop(c) - drop(0) / 2
is not told from zero, so that no slope is estimated. Of this difference's mean and pointwise bounds the nearest falling
curves are taken, which keeps their order, harms no bound where the curve does fall (Chernozhukov, Fernandez-Val and
Galichon, 2009), and leaves one crossing each. A flat curve's interval ends where the doses end.

Straight lines between doses place a step within a tenth of the doses' distance. The interval is about the model's
radius over training sets, over items added, for a planner will meet others of the symbol, and over the items that all
training sets share (pipeline.stats.clusters); it covers the user's margin as often as the model has no bias beyond.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.optimize import isotonic_regression

from pipeline.causal.interventions import DIGITS
from pipeline.stats.clusters import as_from_other_items, by_item
from pipeline.stats.crossed import Estimates, estimate, holm, verdict

FLIP = 0.5  # drop that makes a path which was surely valid more likely invalid


def dose_grid(step: float, doses: int) -> Float[Array, " dose"]:
    """Middle [m] of each interval of clearance, `step` wide; the first lies inside the item: contact."""
    return step * (np.arange(doses) - 0.5)


def paths_at_doses(
    own: Float[Array, "scene path"],
    others: Float[Array, "scene path"],
    grid: Float[Array, " dose"],
    clear_of_others: float,
    count: int,
) -> Int[Array, "scene dose count"]:
    """The first `count` paths at each dose that keep `clear_of_others` [m] from all other items; -1: a missing dose.

    own: clearance [m] from the added item; others: the least from any other. Paths drawn uniformly stay so within a
    dose. A dose with fewer paths is missing in its scene; where contact is, all are, for there is nothing to compare.
    """
    dose = np.floor((own - grid[0]) / (grid[1] - grid[0]) + 0.5)
    chosen = np.full((len(own), len(grid), count), -1)
    for k in range(len(grid)):
        fits = (dose == k) & (others >= clear_of_others)
        enough = fits.sum(1) >= count
        chosen[enough, k] = np.argsort(~fits[enough], axis=1, kind="stable")[:, :count]
    chosen[chosen[:, 0, 0] < 0] = -1
    return chosen


def study(
    drop: Float[Array, "cell seed scene dose"],
    true_drop: Float[Array, "cell scene dose"],
    item: Int[Array, "cell scene"],
    trained: Sequence[int | None],
    margins: Sequence[float | None],
    grid: Float[Array, " dose"],
) -> tuple[list[dict], list[dict]]:
    """One family of cells (users x symbols): each one's envelope beside its true margin [m], and its curve.

    item: which one was added; trained: items of the symbol that the training sets share. NaN: a dose missing in a
    scene. There is an envelope if the drop in contact is an effect (Holm over the family) and makes paths less valid;
    the verdict is reached with Student's test, items in place of scenes and those shared counted as in the radius.
    """
    by_cell = [by_item(*one) for one in zip(drop, item, strict=True)]
    contacts = [_estimate(d[..., 0], items) for d, items in zip(by_cell, trained, strict=True)]
    adjusted = holm(np.array([c.p[0] for c in contacts]))
    cells, curves = [], []
    for i, (contact, p_holm, margin) in enumerate(zip(contacts, adjusted, margins, strict=True)):
        found = verdict(contact.effect[0], p_holm, contact.ci90_low[0], contact.ci90_high[0])
        envelope = radius(by_cell[i], grid, trained[i]) if found == "effect" and contact.effect[0] > 0 else None
        cells.append(_cell(envelope, margin, contact.effect[0], p_holm) | {"verdict": found})
        truth = by_item(true_drop[i][None], item[i])[0]
        scenes = (~np.isnan(true_drop[i])).sum(0)
        curves.append(_curve(by_cell[i], truth, grid, trained[i]) | {"scenes": scenes.tolist()})
    return cells, curves


def radius(
    drop: Float[Array, "seed item dose"], grid: Float[Array, " dose"], trained: int | None = None
) -> tuple[float, float, float]:
    """Clearance [m] of half the effect and its 95 % interval; each within the grid, whose end means "at least".

    trained: items that the training sets share; None: nothing was learned from items.
    """
    halves = [_estimate(drop[..., k] - drop[..., 0] / 2, trained) for k in range(len(grid))]
    bounds = ([getattr(h, name)[0] for h in halves] for name in ("effect", "ci_low", "ci_high"))
    middle, low, high = (_crossing(np.array(bound), grid) for bound in bounds)
    return middle, low, high


def _estimate(drop: Float[Array, "seed item"], trained: int | None = None) -> Estimates:
    """`estimate` over the items of which this dose was asked."""
    asked = drop[:, ~np.isnan(drop).any(0)]
    return estimate((asked if trained is None else as_from_other_items(asked, trained))[None])


def _crossing(values: Float[Array, " dose"], grid: Float[Array, " dose"]) -> float:
    """Where the falling curve nearest to the values meets zero, by straight lines between doses."""
    falling = isotonic_regression(values, increasing=False).x
    after = int((falling > 0).sum())  # the first dose at which it is zero or less
    if after in (0, len(grid)):
        return float(grid[min(after, len(grid) - 1)])
    return float(np.interp(0, -falling[after - 1 : after + 1], grid[after - 1 : after + 1]))


def _cell(
    envelope: tuple[float, float, float] | None, margin: float | None, drop_at_contact: float, p_holm: float
) -> dict:
    """The envelope and the truth; `right`: whether both say that there is one; covered and error: only if both do."""
    middle, low, high = (_rounded(x) for x in envelope) if envelope else (None, None, None)
    error, covered = None, None
    if middle is not None and low is not None and high is not None and margin is not None:
        error, covered = _rounded(middle - margin), low <= margin <= high
    return {
        "radius_m": middle, "ci_low": low, "ci_high": high,
        "truth_m": margin, "error_m": error, "covered": covered,
        "drop_at_contact": _rounded(drop_at_contact), "flips": bool(drop_at_contact > FLIP),
        "p_holm": _rounded(p_holm),
        "right": (middle is None) == (margin is None),
    }  # fmt: skip


def _rounded(value: float) -> float:
    return round(float(value), DIGITS) + 0.0  # + 0.0: never -0.0


def _curve(
    drop: Float[Array, "seed item dose"],
    true_drop: Float[Array, "item dose"],
    grid: Float[Array, " dose"],
    trained: int | None,
) -> dict[str, list]:
    """Mean drop, its 95 % interval and the truth's by dose, over the items of which it was asked."""
    by_dose = [_estimate(drop[..., k], trained) for k in range(len(grid))]
    numbers = {
        "clearance_m": grid,
        "drop": [e.effect[0] for e in by_dose],
        "ci_low": [e.ci_low[0] for e in by_dose],
        "ci_high": [e.ci_high[0] for e in by_dose],
        "truth": np.nanmean(true_drop, axis=0),
    }
    return {name: [_rounded(x) for x in by] for name, by in numbers.items()}


def planning(keeps: Bool[Array, "*path"], valid: Bool[Array, "*path"]) -> dict[str, float | None]:
    """What a planner gets that takes any path which keeps an envelope.

    kept: share of all paths; valid: share of those kept that are truly valid (None: none is kept); wasted: share of
    the truly valid ones that are forbidden.
    """
    numbers = {
        "kept": keeps.mean(),
        "valid": valid[keeps].mean() if keeps.any() else None,
        "wasted": 1 - keeps[valid].mean() if valid.any() else None,
    }
    return {name: None if x is None else _rounded(x) for name, x in numbers.items()}


def nearest_plans(room: Float[Array, " plan"]) -> dict[str, float | int | None]:
    """What plans are worth that keep an envelope and no more; `room` [m]: how much more than the true margin they keep.

    plans: how many; valid: the share that is; short_m: what 99 % of them lack at the most, 0 if so many are valid.
    """
    if not len(room):
        return {"plans": 0, "valid": None, "short_m": 0.0}
    return {
        "plans": len(room),
        "valid": _rounded((room > 0).mean()),
        "short_m": _rounded(max(0.0, -np.quantile(np.minimum(room, 1.0), 0.01))),  # inf: nothing is minded there
    }
