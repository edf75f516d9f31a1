"""Move the item that makes a path invalid, and find how far it must move until the path is valid."""

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.causal.counterfactual import mean, mean_with_interval
from pipeline.world.bezier import curve
from pipeline.world.layout import Layouts
from pipeline.world.rules import SAMPLES

MIN_CASES = 2  # fewest cases per user for which moves are reported


def outward_normal(
    layouts: Layouts, slot: Int[Array, " case"], z_theta: Float[Array, "case 2"]
) -> Float[Array, "case 2"]:
    """Return the unit normal of each path at its point nearest to the item in `slot`, on the item's side."""
    points, case = curve(z_theta, SAMPLES), np.arange(len(slot))
    offset = layouts.centre[case, slot][:, None] - points  # (case, sample, 2)
    nearest = case, np.linalg.norm(offset, axis=-1).argmin(-1)
    tangent = np.gradient(points, axis=1)[nearest]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1) / np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = (normal * offset[nearest]).sum(-1, keepdims=True)
    return np.where(side < 0, -normal, normal)


def translate_item(
    layouts: Layouts, slot: Int[Array, " case"], direction: Float[Array, "case 2"], distance: Float[Array, " step"]
) -> Layouts:
    """Return each scene with the item in `slot` moved by each distance [m]: (case * step), steps varying fastest."""
    case = np.repeat(np.arange(len(layouts)), len(distance))
    moved = layouts[case]
    moved.centre[np.arange(len(case)), slot[case]] += direction[case] * np.tile(distance, len(layouts))[:, None]
    return moved


def crossing(distance: Float[Array, " step"], value: Float[Array, "*b step"], threshold: float) -> Float[Array, "*b"]:
    """Return the first distance at which `value` exceeds the threshold, linear between steps; NaN if none does."""
    above = value > threshold
    after = above.argmax(-1)[..., None]
    before = np.maximum(after - 1, 0)
    low, high = (np.take_along_axis(value, i, -1)[..., 0] for i in (before, after))
    share = (threshold - low) / np.where(high > low, high - low, 1.0)
    start, end = distance[before[..., 0]], distance[after[..., 0]]
    return np.where(above.any(-1), start + np.clip(share, 0.0, 1.0) * (end - start), np.nan)


def score_moves(
    model_m: Float[Array, "seed case"], rejected: Bool[Array, "seed case"], true_m: Float[Array, " case"]
) -> dict[str, float]:
    """Return scores of the models' smallest moves [m] (NaN: none found) against the true ones.

    true_m: mean true move. All other scores refer to the cases that a model rejects before the move. found: share for
    which some move makes the path valid to the model. For these: error_m, mean absolute error; bias_m, mean error;
    constant_error_m, mean absolute error of the median true move.
    """
    row = {"cases": float(len(true_m)), "rejected": rejected.mean() if rejected.size else np.nan}
    if len(true_m) < MIN_CASES:
        return row
    row["true_m"] = true_m.mean()
    if not rejected.any():
        return row
    found = rejected & np.isfinite(model_m)
    return (
        row
        | mean_with_interval("found", np.isfinite(model_m), rejected)
        | mean_with_interval("error_m", np.abs(model_m - true_m), found)
        | mean_with_interval("bias_m", model_m - true_m, found)
        | {"constant_error_m": mean(np.abs(true_m - np.median(true_m)), found)}
    )
