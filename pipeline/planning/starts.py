"""Invalid paths that every method of repair starts from, and the table of what became of them."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array

from pipeline.planning.oracle import nearest_valid
from pipeline.stats.scores import DECISION
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid


@dataclass(frozen=True)
class Starts:
    """One user's invalid paths in some scenes, the same for all seeds and variants."""

    user: str
    margins: Margins
    layouts: Layouts
    scene: Int[Array, " start"]
    start: Int[Array, " start"]  # number of the start within its scene
    z: Float[Array, "start 2"]  # z_theta [m]
    nearest: Float[Array, "start 2"]  # the nearest truly valid z_theta [m]

    @classmethod
    def of(
        cls,
        user: str,
        margins: Margins,
        layouts: Layouts,
        candidates: Float[Array, "scene candidate 2"],
        side: int,
        refinements: int,
    ) -> "Starts":
        """Return those candidates [m] that are invalid to the user; side, refinements: of `oracle.nearest_valid`."""
        scene, start = np.nonzero(~valid(layouts, candidates, margins))
        nearest = nearest_valid(layouts, candidates, margins, side, refinements)[scene, start]
        return cls(user, margins, layouts, scene, start, candidates[scene, start], nearest)


def rows(
    starts: Starts,
    method: str,
    variant: str,
    seed: int,
    ends: Float[Array, "start 2"],
    p_start: Float[Array, " start"] | None = None,
    p_end: Float[Array, " start"] | None = None,
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
