"""Choose paths that are clear cases to a user: far from the boundary between valid and invalid."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack


@dataclass(frozen=True)
class Candidates:
    """Paths [m] in each scene of which clear cases are chosen, with their clearances [m] (as in `rules.clearance`)."""

    layouts: Layouts
    z_theta: Float[Array, "scene candidate 2"]
    clearances: Float[Array, "scene candidate slot"]

    @classmethod
    def of(cls, layouts: Layouts, z_theta: Float[Array, "scene candidate 2"]) -> "Candidates":
        """Measure the clearances of all paths, scene by scene to save memory."""
        rows = [clearance(layouts[[i]], z_theta[[i]]) for i in range(len(layouts))]
        return cls(layouts, z_theta, np.concatenate(rows))

    def choose(
        self, rng: np.random.Generator, margins: Margins, clear_m: float, count: int
    ) -> tuple[Float[Array, "scene path 2"], Bool[Array, "scene path"]]:
        """Choose `count` clear cases to the user in each scene (`clear_cases`); return them with their labels."""
        slacks = slack(self.layouts, self.clearances, margins)
        rows = np.stack([clear_cases(rng, of_scene, clear_m, count) for of_scene in slacks])
        return np.take_along_axis(self.z_theta, rows[..., None], 1), np.take_along_axis(slacks, rows, 1) > 0


def clear_cases(
    rng: np.random.Generator, slacks: Float[Array, " path"], clear_m: float, count: int
) -> Int[Array, " count"]:
    """Return the indices of different paths at least `clear_m` [m] from the boundary, each valid with probability 1/2.

    Where a scene has too few of one label, the other fills in; where it has too few of both, the clearest others.
    """
    valid, invalid = np.flatnonzero(slacks > clear_m), np.flatnonzero(slacks <= -clear_m)
    n_valid = np.clip(rng.binomial(count, 0.5), count - len(invalid), len(valid))
    chosen = np.concatenate([valid[:n_valid], invalid[: count - n_valid]])
    clearest = np.argsort(-np.abs(slacks), kind="stable")
    rest = clearest[~np.isin(clearest, chosen)][: count - len(chosen)]
    return rng.permutation(np.concatenate([chosen, rest]))
