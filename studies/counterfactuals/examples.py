"""Choose worked examples by rules fixed before the results were seen."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.causal.counterfactual import NO_SINGLE_CAUSE, Removals, attribute
from pipeline.stats.scores import DECISION
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import clearance


def choose(truth: Mapping[str, Removals], model: Mapping[str, Removals]) -> dict[str, tuple[int, int]]:
    """Return scene and path of each kind of example, given removals by user; kinds without a match are left out.

    - disagree: the first two users both reject the path, but because of different items.
    - one_accepts: the first user rejects it because of a single item, the second accepts it.
    - model_wrong: the model rejects an invalid path but attributes it to another item than the cause.

    Each example is the first path of the first scene that no other example uses.
    """
    rejected = np.stack([t.factual == 0 for t in truth.values()])  # (user, scene, path)
    cause = np.stack([attribute(t.necessity) for t in truth.values()])
    rejects = np.stack([model[user].factual <= DECISION for user in truth])
    attributed = np.stack([attribute(model[user].necessity) for user in truth])
    fitting = {"model_wrong": (rejects & (cause != NO_SINGLE_CAUSE) & (attributed != cause)).any(0)}
    if len(truth) > 1:
        fitting = dict(zip(("disagree", "one_accepts"), disagreements(rejected, cause), strict=True)) | fitting
    chosen: dict[str, tuple[int, int]] = {}
    for kind, paths in fitting.items():
        place = first_path(paths, {scene for scene, _ in chosen.values()})
        if place is not None:
            chosen[kind] = place
    return chosen


def disagreements(
    rejected: Bool[Array, "user scene path"], cause: Int[Array, "user scene path"]
) -> tuple[Bool[Array, "scene path"], Bool[Array, "scene path"]]:
    """Return the paths that the first two users reject for different reasons, and those that only the first rejects."""
    return (
        rejected[0] & rejected[1] & (cause[0] != cause[1]),
        rejected[0] & (cause[0] != NO_SINGLE_CAUSE) & ~rejected[1],
    )


def first_path(fitting: Bool[Array, "scene path"], taken: Collection[int]) -> tuple[int, int] | None:
    """Return the first scene that is not taken and its first path; None if there is none."""
    scene, path = np.nonzero(fitting)
    free = ~np.isin(scene, list(taken))
    return (int(scene[free][0]), int(path[free][0])) if free.any() else None


def example_rows(
    kind: str,
    place: tuple[int, int],
    layouts: Layouts,
    z_theta: Float[Array, "scene path 2"],
    user: str,
    answers: Mapping[str, Removals],
) -> pd.DataFrame:
    """Return one row per variant (including "truth") and item; lengths in metres.

    p: P(valid) in the original scene; p_empty, p_without, p_alone: in its other versions; attributed: whether the
    rejection is attributed to this item.
    """
    scene, path = place
    slots = np.flatnonzero(layouts.present[scene])
    item = {
        "slot": slots,
        "symbol": np.array(SYMBOLS)[layouts.symbol[scene, slots]],
        "x_m": layouts.centre[scene, slots, 0],
        "y_m": layouts.centre[scene, slots, 1],
        "clearance_m": clearance(layouts[[scene]], z_theta[[scene]])[0, path, slots],
    }
    z_x, z_y = z_theta[place]
    rows = [
        pd.DataFrame(
            {"example": kind, "scene": scene, "path": path, "z_x": z_x, "z_y": z_y, "user": user, "variant": variant}
            | item
            | {
                "p": answer.factual[place],
                "p_empty": answer.empty[place],
                "p_without": answer.without[place][slots],
                "p_alone": answer.alone[place][slots],
                "pn": answer.necessity[place][slots],
                "ps": answer.sufficiency[place][slots],
                "attributed": slots == attribute(answer.necessity[place]),
            }
        )
        for variant, answer in answers.items()
    ]
    return pd.concat(rows, ignore_index=True)
