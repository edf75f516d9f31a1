"""Invalid paths that every method of repair starts from, the table of what became of them, and its measures."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.planning.nearest import Z, nearest_valid
from pipeline.stats.crossed import Items, quartiles, ratio
from pipeline.stats.scores import DECISION
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

Candidates = Float[Array, "scene candidate 2"]  # z_theta [m]
Chances = Float[Array, " start"] | None  # P(valid)
GROUP = ["method", "variant", "user"]
COLUMNS = [
    *GROUP, "seeds", "starts", "success", "success_q1", "success_q3", "success_ci_low", "success_ci_high",
    "displacement_ratio", "accepted", "unsafe",
]  # fmt: skip


@dataclass(frozen=True)
class Starts:
    """Paths in some scenes that one user's repairs start from, the same for all seeds and variants."""

    user: str
    margins: Margins
    layouts: Layouts
    scene: Int[Array, " start"]
    start: Int[Array, " start"]  # number of the start within its scene
    z: Z
    nearest: Z  # the nearest truly valid z_theta [m]

    @classmethod
    def of(
        cls, user: str, margins: Margins, layouts: Layouts, candidates: Candidates, side: int, refinements: int,
        chosen: Bool[Array, "scene candidate"] | None = None,
    ) -> "Starts":  # fmt: skip
        """Return the chosen candidates [m], or those invalid to the user; side, refinements: of `nearest_valid`."""
        scene, start = np.nonzero(~valid(layouts, candidates, margins) if chosen is None else chosen)
        nearest = nearest_valid(layouts, candidates, margins, side, refinements)[scene, start]
        return cls(user, margins, layouts, scene, start, candidates[scene, start], nearest)

    def select(self, chosen: Bool[Array, "scene candidate"]) -> "Starts":
        """Return those of the starts that are chosen."""
        kept = chosen[self.scene, self.start]
        parts = {name: getattr(self, name)[kept] for name in ("scene", "start", "z", "nearest")}
        return replace(self, **parts)


def rows(
    starts: Starts, method: str, variant: str, seed: int, ends: Z, p_start: Chances = None, p_end: Chances = None
) -> pd.DataFrame:
    """Return one row per start: end point [m], the model's P(valid) at both (if there is a model), and the truth."""
    ends = ends.astype(np.float64)
    layouts = starts.layouts[starts.scene]  # one layout per row
    clearances = slack(layouts, clearance(layouts, ends[:, None]), starts.margins)[:, 0]
    return pd.DataFrame(
        {
            "method": method, "variant": variant, "user": starts.user, "seed": seed,
            "scene": starts.scene, "start": starts.start,
            "z0_x": starts.z[:, 0], "z0_y": starts.z[:, 1], "z_x": ends[:, 0], "z_y": ends[:, 1],
            "p_start": np.nan if p_start is None else p_start,
            "p_end": np.nan if p_end is None else p_end,
            "valid_end": clearances > 0,
            "accepted": pd.array([None] * len(ends) if p_end is None else p_end > DECISION, dtype="boolean"),
            "displacement_m": np.linalg.norm(ends - starts.z, axis=-1),
            "oracle_displacement_m": np.linalg.norm(starts.nearest - starts.z, axis=-1),
            "clearance_m": clearances,  # slack: clearance minus the user's margin, smallest over items
        }
    )  # fmt: skip


def measures(repairs: pd.DataFrame, items: Items = None) -> pd.DataFrame:
    """Return the measures of each method, variant and user, one row each, in the order of their first row.

    repairs: one row per start and seed (`rows`). Columns of the result:
    seeds, starts (per seed);
    success: share of repaired paths that are truly valid, with quartiles over seeds and a 95 % interval over seeds
    crossed with scenes (NaN for a single scene), and with the `items` (scene, item) of all scenes if they are chance;
    displacement_ratio: sum of displacements over the sum of displacements to the nearest valid paths (NaN if all are
    valid);
    accepted: share of repaired paths with p > .5; unsafe: share of all starts accepted although truly invalid.
    The last two are NaN for baselines, which have no model.
    """
    measured = []
    for group, rows in repairs.groupby(GROUP, sort=False):
        accepted = rows["accepted"].to_numpy(dtype=float, na_value=np.nan)
        by_seed = rows.groupby("seed")["valid_end"].agg(["mean", "size"])
        success = quartiles(by_seed["mean"].to_numpy())
        moved, least = (float(rows[name].sum()) for name in ("displacement_m", "oracle_displacement_m"))
        unsafe = float((accepted * ~rows["valid_end"].to_numpy(dtype=bool)).mean())
        sums = rows.groupby(["seed", "scene"])["valid_end"].agg(["sum", "size"])
        by_scene = sums.unstack()
        successes, starts = (by_scene[name].to_numpy(dtype=float)[None] for name in ("sum", "size"))
        low = high = np.nan
        if starts.shape[2] >= 2:
            interval = ratio(successes, starts, None if items is None else items[by_scene["sum"].columns])
            low, high = (float(end[0].clip(0, 1)) for end in (interval.ci_low, interval.ci_high))
        measured.append((
            *group, len(by_seed), int(by_seed["size"].iloc[0]), success["mean"], success["q1"], success["q3"],
            low, high, moved / least if least else np.nan, float(accepted.mean()), unsafe,
        ))  # fmt: skip
    return pd.DataFrame(measured, columns=COLUMNS)
